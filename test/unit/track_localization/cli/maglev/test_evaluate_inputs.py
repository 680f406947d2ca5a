"""What ``evaluate maglev`` makes of a bag and the files beside it, and says of each lack."""

import argparse
import dataclasses

import numpy as np
import pytest

from maglev_localization.measurements import BalisePassing, LoopPosition, RadarSpeed
from track_localization.cli.maglev.inputs import Inputs, add_arguments, read_inputs
from track_localization.errors import DataError
from track_localization.track.track_file import TrackFile, write_track


def read(run, *arguments: str, **changes: object) -> Inputs:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    args = parser.parse_args([str(run.bag), *arguments])
    args.set = list(changes.items())
    return read_inputs(args)


def at(measurements, kind):
    return [m for m in measurements if isinstance(m, kind)]


def curved_track(radius_m: float = 500.0) -> TrackFile:
    """A circle's arc of 900 m, counter-clockwise from the origin towards x."""
    angle = np.arange(0.0, 1.8, 0.01)
    zero = np.zeros_like(angle)
    front = np.stack([np.cos(angle), np.sin(angle), zero], axis=1)
    left = np.stack([-np.sin(angle), np.cos(angle), zero], axis=1)
    position = radius_m * np.stack([np.sin(angle), 1.0 - np.cos(angle), zero], axis=1)
    return TrackFile(position, front, left, np.tile([0.0, 0.0, 1.0], (len(angle), 1)))


def on_the_arc(s: float, radius_m: float = 500.0) -> tuple[float, float, float]:
    a = s / radius_m
    return radius_m * np.sin(a), radius_m * (1.0 - np.cos(a)), 0.0


def test_measurements_in_order_of_arrival(run):
    kind, rows = run.topics['/loop/pose']
    late = [(t + 0.55 if k == 30 else t, message) for k, (t, message) in enumerate(rows)]
    run.topics['/loop/pose'] = (kind, late)
    run.write()
    inputs = read(run)
    assert inputs.measurements[:3] == [
        LoopPosition(1000.0, 0.0, 0.01),
        RadarSpeed(1000.0, 0.0, 0.01),
        LoopPosition(1000.1, 0.0, 0.01),
    ]
    loop = [m.time_s for m in at(inputs.measurements, LoopPosition)]
    assert loop[30:35] == pytest.approx([1003.1, 1003.2, 1003.3, 1003.4, 1003.5])
    assert loop[35] == pytest.approx(1003.0)
    passed = at(inputs.measurements, BalisePassing)
    assert passed[1] == BalisePassing(1012.0, 'B', 0.0, 1e-4)
    assert inputs.first_balise_s == 1007.0
    assert inputs.findings == []
    assert inputs.rejected == {}
    assert inputs.line_length_m == 0.0
    assert set(inputs.files) == {'bag', 'balises'}


def test_without_a_track_x_is_the_chainage(run):
    truth = read(run).truth
    np.testing.assert_allclose(truth.chainage, np.maximum(truth.time_s - 1002.0, 0.0) * 20.0)
    np.testing.assert_array_equal(truth.chainage, truth.position[:, 0])
    np.testing.assert_allclose(truth.velocity[truth.time_s > 1002.2, 0], 20.0)


def test_with_a_track_the_truth_is_projected_on_it(run):
    """The arc's chainage is its length; x would be up to 5 % less."""
    from track_localization.cli.maglev import truth as places

    run.topics['/ground_truth/odometry'] = _moved(run, on_the_arc)
    run.write()
    write_track(run.folder / 'track.csv', curved_track())
    inputs = read(run)
    expected = np.maximum(inputs.truth.time_s - 1002.0, 0.0) * 20.0
    # A cubic through points 5 m apart on this arc is off by far less than 1 mm.
    np.testing.assert_allclose(inputs.truth.chainage, expected, atol=1e-3)
    assert expected.max() - inputs.truth.position[:, 0].max() > 10.0
    assert inputs.line_length_m == pytest.approx(500.0 * 1.79, abs=0.01)
    assert inputs.findings == []
    estimate = dataclasses.replace(
        inputs.truth,
        position=np.zeros_like(inputs.truth.position),
        speed=np.full(len(inputs.truth), 20.0),
        sigma_along=np.full(len(inputs.truth), 0.3),
    )
    placed = places.placed(estimate, inputs.line)
    np.testing.assert_allclose(placed.position, inputs.truth.position, atol=1e-3)
    angle = expected / 500.0
    np.testing.assert_allclose(placed.velocity[:, 1], 20.0 * np.sin(angle), atol=1e-2)
    along = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    variance = np.einsum('ij,ijk,ik->i', along, placed.covariance, along)
    np.testing.assert_allclose(variance, 0.09, rtol=1e-4)


def test_a_truth_off_the_line_is_told(run):
    run.topics['/ground_truth/odometry'] = _moved(run, lambda s: (s, 40.0, 0.0))
    run.write()
    (finding,) = read(run).findings
    assert '40 m' in finding
    assert '--track' in finding
    write_track(run.folder / 'track.csv', curved_track())
    (finding,) = read(run).findings
    assert 'track.csv' in finding


def _moved(run, place):
    kind, rows = run.topics['/ground_truth/odometry']
    for _, message in rows:
        p = message.pose.pose.position
        p.x, p.y, p.z = place(p.x)
    return kind, rows


@pytest.mark.parametrize(
    ('topic', 'words'),
    [
        ('/loop/pose', ['No loop/pose', 'without the loop']),
        ('/radar/twist', ['No radar/twist', 'without the radar']),
        ('/balise/pose', ['No balise/pose', 'without the balise']),
        ('/ground_truth/odometry', ['No ground truth', 'errors are left out']),
    ],
)
def test_a_topic_that_is_missing_is_told_and_the_rest_is_read(run, topic, words):
    del run.topics[topic]
    run.write()
    inputs = read(run)
    (finding,) = inputs.findings
    assert all(word in finding for word in words)
    kinds = {type(m) for m in inputs.measurements}
    assert len(kinds) == (3 if topic.startswith('/ground') else 2)
    assert (inputs.truth is None) == topic.startswith('/ground')


def test_without_a_table_balises_are_read_and_told(run):
    (run.folder / 'balises.csv').unlink()
    inputs = read(run)
    assert len(inputs.balises) == 0
    assert len(at(inputs.measurements, BalisePassing)) == 3
    assert inputs.first_balise_s is None
    assert any('--balises' in finding for finding in inputs.findings)


def test_the_table_of_another_line_is_told(run):
    run.write_balises('K9,100.0,0.05')
    inputs = read(run)
    assert inputs.first_balise_s is None
    (finding,) = inputs.findings
    assert all(word in finding for word in ('A, B, C', 'K9', 'another line'))


def test_estimates_can_know_a_late_balise_from_its_arrival_on(run):
    """The first, passed at 1007.0 s, is recorded a second later: by then the loop was at 1007.9."""
    kind, rows = run.topics['/balise/pose']
    (_, message), *others = rows
    run.topics['/balise/pose'] = (kind, [(1007.95, message), *others])
    run.write()
    assert read(run).first_balise_s == pytest.approx(1007.9, abs=0.051)


def test_a_named_table_comes_before_the_one_beside_the_bag(run, tmp_path):
    other = tmp_path / 'other.csv'
    other.write_text('id,chainage_m,sigma_m\nB,222.0,0.1\n')
    inputs = read(run, '--balises', str(other))
    assert inputs.balises.id == ('B',)
    assert inputs.first_balise_s == 1012.0


@pytest.mark.parametrize(
    ('rows', 'words'),
    [
        (['A,100.0,0.05', 'A,200.0,0.05'], ['balises.csv', 'line 3', 'A stands in line 2']),
        (['A,nan,0.05'], ['balises.csv', 'line 2', 'chainage_m']),
        (['A,100.0,0'], ['balises.csv', 'line 2', 'sigma_m']),
    ],
)
def test_a_wrong_table_is_told_with_the_line(run, rows, words):
    run.write_balises(*rows)
    with pytest.raises(DataError) as error:
        read(run)
    assert all(word in str(error.value) for word in words)


def test_frames_of_another_kind_are_counted_and_told(run):
    """Half of the loop in map, one balise without a name: counted; all of it: told."""
    for k, (_, message) in enumerate(run.topics['/loop/pose'][1]):
        if k % 2:
            message.header.frame_id = 'map' if k % 4 == 1 else ''
    run.topics['/balise/pose'][1][0][1].header.frame_id = 'balise_'
    run.write()
    inputs = read(run)
    assert inputs.rejected == {
        'loop': {'wrong_frame': 55, 'empty_frame': 55}, 'balise': {'wrong_frame': 1}
    }  # fmt: skip
    assert len(at(inputs.measurements, LoopPosition)) == 110
    assert inputs.findings == []
    for _, message in run.topics['/loop/pose'][1]:
        message.header.frame_id = 'odom'
    run.write()
    (finding,) = read(run).findings
    assert all(word in finding for word in ('loop/pose', "frame_id 'track'"))


def test_stamps_before_1970_are_counted(run):
    for _, message in run.topics['/radar/twist'][1][:3]:
        message.header.stamp.sec = -5
    run.write()
    inputs = read(run)
    assert inputs.rejected == {'radar': {'bad_stamp': 3}}
    assert len(at(inputs.measurements, RadarSpeed)) == 217


def test_frames_may_stand_in_a_namespace(run):
    for topic in ('/loop/pose', '/balise/pose'):
        for _, message in run.topics[topic][1]:
            message.header.frame_id = 'train1/' + message.header.frame_id
    run.write()
    inputs = read(run)
    assert inputs.rejected == {}
    assert {m.balise for m in at(inputs.measurements, BalisePassing)} == {'A', 'B', 'C'}
    assert inputs.findings == []


def test_nothing_of_use_is_an_error(run):
    run.topics = {'/loop/pose': run.topics['/loop/pose']}
    for _, message in run.topics['/loop/pose'][1]:
        message.header.frame_id = ''
    run.write()
    with pytest.raises(DataError, match=r'empty_frame'):
        read(run)


def test_topics_by_other_names(run):
    for topic in ('/radar/twist', '/ground_truth/odometry'):
        run.topics['/my' + topic.replace('/', '_')] = run.topics.pop(topic)
    run.write()
    inputs = read(
        run,
        *('--remap', 'radar/twist:=/my_radar_twist'),
        *('--truth-topic', '/my_ground_truth_odometry'),
    )
    assert len(at(inputs.measurements, RadarSpeed)) == 220
    assert len(inputs.truth) == 220
    remapped = read(run, '--remap', 'ground_truth/odometry:=/my_ground_truth_odometry')
    assert len(remapped.truth) == 220
    with pytest.raises(DataError, match=r'/none; topics here: .*/my_ground_truth_odometry'):
        read(run, '--truth-topic', '/none')
    with pytest.raises(DataError, match=r'--remap wheel/twist: .*radar/twist'):
        read(run, '--remap', 'wheel/twist:=/w')


PARAMETERS = """
/**:
  ros__parameters:
    balises: {balises}
    publish_tf: true
train1/maglev_federated_pf:
  ros__parameters:
    method: kalman
    loop: {{pitch_m: 0.3}}
    placing.across_sigma_m: 0.1
    predict_to_now: true
coaster_eskf:
  ros__parameters:
    eskf.n: 3.0
"""


def test_the_nodes_parameter_file_and_set(run, tmp_path):
    """``--set`` comes after the file; files that it names come before those beside the bag."""
    table = tmp_path / 'mine.csv'
    table.write_text('id,chainage_m,sigma_m\nC,333.0,0.1\n')
    file = tmp_path / 'maglev.yaml'
    file.write_text(PARAMETERS.format(balises=table))
    inputs = read(run, '--config', str(file), **{'loop.pitch_m': '0.25', 'particles': '50'})
    assert inputs.config.method == 'kalman'
    assert inputs.config.loop.pitch_m == 0.25
    assert inputs.config.particles == 50
    assert inputs.balises.id == ('C',)
    file.write_text('maglev_federated_pf:\n  ros__parameters:\n    loop.pitch: 0.3\n')
    with pytest.raises(DataError, match=r'maglev\.yaml.*loop\.pitch'):
        read(run, '--config', str(file))

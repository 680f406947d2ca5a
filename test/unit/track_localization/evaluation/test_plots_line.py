"""Pictures of a run on a line: what should be in them is in them, and nothing is too odd."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from track_localization.estimation.trajectory import Trajectory
from track_localization.evaluation import plots_line
from track_localization.evaluation.plots_style import colour

BEGIN, END = 1000.0, 1060.0


def pixels(file: Path, shade: str) -> int:
    """Return how many pixels have this colour."""
    picture = imread(file)[..., :3]
    return int((np.abs(picture - np.array(to_rgb(shade))).max(axis=-1) < 0.02).sum())


def run(offset: float = 0.0) -> Trajectory:
    time = np.arange(BEGIN, END, 0.1)
    speed = 10.0 + 5.0 * np.sin(0.2 * (time - BEGIN)) + offset
    s = np.cumsum(speed) * 0.1 + offset
    position = np.stack([s, np.zeros_like(s), np.zeros_like(s)], axis=1)
    return Trajectory(
        time, position, chainage=s, speed=speed, sigma_along=np.full(len(s), 0.1 + offset)
    )


@pytest.fixture
def tracks() -> dict[str, Trajectory]:
    return {'robust': run(0.6), 'paper': run(2.0)}


@pytest.mark.parametrize('truth', [None, run()], ids=['no truth', 'truth'])
def test_every_method_is_in_the_speeds(tmp_path, tracks, truth):
    """The truth adds a panel for each method and its own dashes, black as the axes are."""
    file = plots_line.speeds(tmp_path / 'a.png', tracks, truth, BEGIN)
    bare = plots_line.speeds(tmp_path / 'b.png', tracks, None, BEGIN)
    for name in tracks:
        assert pixels(file, colour(name)) > 200
    assert (imread(file).shape[0] > imread(bare).shape[0]) == (truth is not None)


def test_places_show_balises_and_doubt(tmp_path, tracks):
    file = plots_line.places(tmp_path / 'a.png', tracks, run(), np.array([100.0, 400.0]), BEGIN)
    bare = plots_line.places(tmp_path / 'b.png', tracks, None, np.empty(0), BEGIN)
    assert pixels(file, plots_line.MARK) > 20
    assert pixels(bare, plots_line.MARK) == 0
    for name in tracks:
        assert pixels(bare, colour(name)) > 200


def test_health_is_as_long_as_the_states_lasted(tmp_path):
    """Silent for 10 s of 60, isolated for 20 s: twice the area, to the pixels of the edges."""
    states = [
        (BEGIN, 'loop', 'ok'),
        (BEGIN, 'radar', 'ok'),
        (BEGIN + 10.0, 'loop', 'silent'),
        (BEGIN + 20.0, 'loop', 'ok'),
        (BEGIN + 40.0, 'loop', 'isolated'),
    ]
    heard = {
        'loop': np.arange(BEGIN, END, 0.02),
        'radar': np.arange(BEGIN, END, 0.05),
        'balise': np.array([BEGIN + 7.0]),
    }
    file = plots_line.health(tmp_path / 'a.png', {'robust': states}, heard, (BEGIN, END))
    silent = pixels(file, plots_line.STATE_COLOURS['silent'])
    isolated = pixels(file, plots_line.STATE_COLOURS['isolated'])
    # The legend's two patches add the same few hundred pixels to both.
    assert silent > 1000
    assert 1.7 < isolated / silent < 2.1


def test_states_of_another_name_get_a_colour_each(tmp_path):
    states = [(BEGIN, 'loop', 'warming'), (BEGIN + 20.0, 'loop', 'broken')]
    file = plots_line.health(
        tmp_path / 'a.png', {'robust': states}, {'loop': np.empty(0)}, (BEGIN, END)
    )
    assert all(pixels(file, shade) > 500 for shade in plots_line.OTHER_STATES[:2])


def test_nothing_at_all_is_still_a_picture(tmp_path):
    heard = {'loop': np.empty(0), 'radar': np.array([BEGIN])}
    file = plots_line.health(tmp_path / 'a.png', {'robust': []}, heard, (BEGIN, BEGIN))
    assert imread(file).shape[1] > 500
    empty = Trajectory(np.array([BEGIN]), np.zeros((1, 3)), chainage=np.zeros(1), speed=np.zeros(1))
    far = Trajectory(run().time_s + 1e4, run().position, speed=run().speed)
    for truth in (None, far):
        assert plots_line.speeds(tmp_path / 'b.png', {'robust': empty}, truth, BEGIN).exists()
        assert plots_line.places(
            tmp_path / 'c.png', {'robust': empty}, truth, np.empty(0), BEGIN
        ).exists()

"""The maglev paper's claims beside ours: one drive, tables of given figures, the pictures."""

import numpy as np
import pytest

from track_localization.cli.maglev import reproduce_paper
from track_localization.cli.maglev.reproduce_paper import CLAIMS, LOOPS, Result
from track_localization.sim.maglev import scenario, simulate_maglev

PICTURES = [f'fig{k}.png' for k in range(2, 7)]


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(reproduce_paper, 'METHODS', ('paper',))
    monkeypatch.setattr(reproduce_paper, 'COUNTS', (100,))


def test_one_drive_with_either_loop():
    """An absolute loop's errors are its noise's; a counter is off by what it has missed."""
    result = reproduce_paper.run_seed(3)
    absolute, counter = (result.entries[f'{loop}.paper'] for loop in LOOPS)
    assert set(absolute) == set(counter) == set(CLAIMS)
    # 0.07 m rms and at most 4 sigma of it in a hundred epochs.
    assert 0.05 < absolute['most_m'] < 0.5
    assert absolute['early_m'] <= absolute['most_m']
    run = simulate_maglev(scenario('paper_missed'), 3)
    missed = run.chainage[-1] - run.chainage[0] - (run.loop.value[-1] - run.loop.value[0])
    # A filter that believes its counter to 0.1 m is at most some tenths from it.
    assert counter['most_m'] == pytest.approx(missed, abs=0.7)
    assert counter['balises_m'] < 0.5 * counter['most_m']
    assert counter['balises_early_m'] < counter['most_m']
    assert -1.0 < counter['speed_least'] < 0.0 < counter['speed_most'] < 1.0


def test_particles_are_judged_by_the_optimum():
    entries = reproduce_paper.particle_figures(4)
    assert set(entries) == {'optimal', 'mean.100', 'mean_covariance.100'}
    for name in ('mean.100', 'mean_covariance.100'):
        # A hundred particles are 5 % worse on average; one drive tells that to 15 %.
        assert 0.7 < entries[name]['place'] / entries['optimal']['place'] < 1.6
        assert entries[name]['most'] < reproduce_paper.LOST_M


def results_of(figures):
    """Return results whose every entry has the given figure, one result for each number."""
    return [
        Result(k, {}, {f'{loop}.paper': dict.fromkeys(CLAIMS, value) for loop in LOOPS})
        for k, value in enumerate(figures)
    ]


def test_claims_table_tells_median_and_worst():
    table = reproduce_paper.claims_table(results_of([0.1, -0.7, 0.3]))
    assert list(table.columns) == ['', 'paper', 'absolute loop: paper', 'counter: paper']
    assert [row[2] for row in table.rows] == ['0.10 (-0.70)'] * len(CLAIMS)
    assert '3 runs' in table.title
    assert [row[1] for row in table.rows] == [
        'small',
        '10, growing',
        '-0.3',
        '0.4',
        'as Fig. 4',
        '1',
    ]


def test_particles_table_pools_runs_and_counts_the_lost():
    def one(place, most):
        return {'place': place, 'speed': 4.0 * place, 'most': most}

    results = [
        Result(
            k,
            {},
            {
                'optimal': one(0.01, 0.3),
                'mean.100': one(place, most),
                'mean_covariance.100': one(0.01, 0.3),
            },
        )
        for k, (place, most) in enumerate([(0.01, 0.4), (0.07, 2.0)])
    ]
    table = reproduce_paper.particles_table(results)
    optimal, mean, whole = table.rows
    assert optimal[2] == pytest.approx(0.1)
    assert mean[2] == pytest.approx(0.2)
    assert mean[3] == pytest.approx(0.4)
    assert mean[4:] == ('2.0000', '2.0000', '1')
    assert whole[4:] == ('1.0000', '1.0000', '0')


def test_figures_are_drawn_and_runs_kept(tmp_path):
    tables = reproduce_paper.paper_tables(range(5, 6), 1, tmp_path)
    assert [len(table.rows) for table in tables] == [len(CLAIMS), 3]
    pictures = [(tmp_path / name).read_bytes() for name in PICTURES]
    assert len(set(pictures)) == len(pictures)
    assert min(len(picture) for picture in pictures) > 10000
    (kept,) = (tmp_path / 'paper_runs').iterdir()
    again = reproduce_paper.read_result(kept, 5, None)
    assert again is not None
    assert np.isfinite(list(again.entries['counter.paper'].values())).all()
    # A second time prints the same from the file.
    assert reproduce_paper.paper_tables(range(5, 6), 1, tmp_path)[0].rows == tables[0].rows

"""Balises: where they lie, which are heard, and what they tell."""

import numpy as np
import pytest

from track_localization.errors import DataError
from track_localization.settings import override
from track_localization.sim.maglev.balise import hear_balises, lay_balises
from track_localization.sim.maglev.config import BaliseErrors
from track_localization.sim.maglev.motion import Motion

FAULTLESS = {
    'missed': 0.0,
    'wrong_id': 0.0,
    'jitter_s': 0.0,
    'offset_sigma_m': 0.0,
    'survey_sigma_m': 0.0,
}
SPEED = 25.0


def even(length, start=0.0):
    """Return motion at 25 m/s, by its closed form."""
    return Motion(
        np.array([0.0, (length - start) / SPEED]),
        np.array([start, length]),
        np.array([SPEED] * 2),
        np.zeros(2),
        np.zeros(1),
    )


def heard(length=2001.0, seed=1, start=0.0, **changes):
    """Return passings and table of a line with a balise every 10 m."""
    config = override(BaliseErrors(), {**FAULTLESS, 'first_m': 10.0, 'spacing_m': 10.0, **changes})
    rng = np.random.default_rng(seed)
    table, place = lay_balises(rng, config, length)
    return hear_balises(rng, config, even(length, start), table, place)[0], table


def test_one_every_kilometre_before_the_end():
    """Of 7 km: six, at 1 to 6 km, of different names, with the survey's sigma."""
    table, place = lay_balises(np.random.default_rng(1), BaliseErrors(), 7000.0)
    np.testing.assert_array_equal(table.chainage, 1000.0 * np.arange(1, 7))
    np.testing.assert_array_equal(table.sigma, 0.05)
    assert len(set(table.id)) == 6
    assert place.shape == (6,)


def test_survey_error_of_the_table():
    """True place less table: N(0, 0.05 m); 10,000 draws tell the sigma to 0.7 %."""
    config = override(BaliseErrors(), {'spacing_m': 1.0, 'first_m': 1.0})
    table, place = lay_balises(np.random.default_rng(1), config, 10001.0)
    error = place - table.chainage
    assert error.std() == pytest.approx(0.05, rel=4 * 0.0071)
    assert error.mean() == pytest.approx(0.0, abs=4 * 0.05 / 100)


def test_an_exact_survey_still_claims_something():
    table, place = lay_balises(
        np.random.default_rng(1), override(BaliseErrors(), FAULTLESS), 7000.0
    )
    np.testing.assert_array_equal(place, table.chainage)
    assert (table.sigma > 0.0).all()


def test_without_faults_each_is_heard_as_it_is_crossed():
    passings, table = heard()
    assert passings.id == table.id
    np.testing.assert_allclose(passings.time_s, table.chainage / SPEED, atol=1e-9)
    np.testing.assert_array_equal(passings.offset, 0.0)
    assert (passings.variance > 0.0).all()


def test_only_what_is_passed_is_heard():
    """A start in the middle of the line: the balises behind it stay unheard."""
    passings, table = heard(start=1005.0)
    assert passings.id == table.id[100:]


def test_share_of_missed_passings():
    """5 % of 20,000: four sigma are 0.6 %."""
    passings, table = heard(200_001.0, missed=0.05)
    share = 1.0 - len(passings.id) / len(table)
    assert share == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / 20_000))


@pytest.mark.parametrize('share', [0.02, 0.2])
def test_share_of_wrong_ids(share):
    """They are ids of the table, spread over it, and never the right one by chance."""
    passings, table = heard(200_001.0, wrong_id=share)
    true = np.array(table.id)
    told = np.array(passings.id)
    wrong = told != true
    assert wrong.mean() == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / 20_000))
    place = np.array([table.index(name) for name in told[wrong]], dtype=float)
    assert place.mean() == pytest.approx(9999.5, abs=4 * 5774 / np.sqrt(wrong.sum()))


def test_wrong_ids_among_two_balises():
    """With two in the table the other one is told; with one there is no other."""
    passings, table = heard(21.0, wrong_id=1.0)
    assert passings.id == table.id[::-1]
    passings, table = heard(11.0, wrong_id=1.0)
    assert passings.id == table.id


def test_share_of_unknown_ids():
    passings, table = heard(100_001.0, unknown_id=0.1, wrong_id=0.2)
    places = [table.index(name) for name in passings.id]
    unknown = np.array([place is None for place in places])
    wrong = np.array([place not in (None, i) for i, place in enumerate(places)])
    assert unknown.mean() == pytest.approx(0.1, abs=4 * 0.003)
    assert wrong.mean() == pytest.approx(0.2, abs=4 * 0.004)


def test_jitter_of_the_crossing_time():
    """2 ms, 1 sigma, over 10,000 crossings."""
    passings, table = heard(100_001.0, jitter_s=0.002)
    error = passings.time_s - table.chainage / SPEED
    assert error.std() == pytest.approx(0.002, rel=4 * 0.0071)


def test_stamps_are_in_order_even_if_jitter_is_great():
    passings, table = heard(jitter_s=1.0)
    assert (np.diff(passings.time_s) >= 0.0).all()
    assert passings.id != table.id
    assert sorted(passings.id) == sorted(table.id)


def test_offset_of_the_antenna():
    """At the crossing it is 0; what is told errs by 0.02 m, 1 sigma, and claims so."""
    passings, _ = heard(100_001.0, offset_sigma_m=0.02)
    assert passings.offset.std() == pytest.approx(0.02, rel=4 * 0.0071)
    np.testing.assert_allclose(passings.variance, 0.02**2)


def test_none_is_heard_while_the_reader_fails():
    passings, table = heard(dead_from_s=20.0, dead_for_s=40.0)
    assert passings.time_s[passings.time_s < 20.0].size == 49
    assert not ((passings.time_s >= 20.0) & (passings.time_s < 60.0)).any()
    assert passings.id[-1] == table.id[-1]


def test_a_line_needs_a_balise():
    with pytest.raises(DataError, match=r'balise\.first_m: 1000\.0 m, but the line ends at 900'):
        lay_balises(np.random.default_rng(1), BaliseErrors(), 900.0)

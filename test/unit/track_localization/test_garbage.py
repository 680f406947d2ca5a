"""The search for cycles is off in a run, and on again after it."""

import gc

import pytest

from track_localization import garbage


def test_it_is_off_inside_and_as_before_after():
    assert gc.isenabled()
    with garbage.paused():
        assert not gc.isenabled()
        with garbage.paused():
            pass
        assert not gc.isenabled()
    assert gc.isenabled()


def test_an_error_does_not_leave_it_off():
    with pytest.raises(ValueError, match='inside'), garbage.paused():
        raise ValueError('inside')
    assert gc.isenabled()

import io

import pytest

from track_localization.cli.progress import Progress, duration


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Clock:
    """A clock that only moves when told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_pipe_gets_the_first_line_and_then_one_in_two_seconds():
    stream, clock = io.StringIO(), Clock()
    with Progress(5, 'method', stream=stream, clock=clock) as progress:
        for name, at in (('a', 0.0), ('b', 0.5), ('c', 1.9), ('d', 2.1), ('e', 9.0)):
            clock.now = at
            progress.begin(name)
            progress.done()
    assert stream.getvalue().splitlines() == ['method 1/5: a', 'method 4/5: d', 'method 5/5: e']


def test_a_terminal_sees_one_line_rewritten():
    stream = Terminal()
    with Progress(2, 'method', stream=stream, clock=Clock()) as progress:
        progress.begin('a long name')
        progress.done()
        progress.begin('b')
    assert stream.getvalue() == '\rmethod 1/2: a long name\rmethod 2/2: b' + ' ' * 10 + '\n'


def test_the_bar_tells_the_time_left():
    """One of four done in 30 s leaves three times 30 s."""
    stream, clock = io.StringIO(), Clock()
    progress = Progress(4, 'rides', stream=stream, clock=clock)
    clock.now = 30.0
    progress.done()
    progress.bar('mine 3')
    assert stream.getvalue() == 'rides [#####...............] 1/4, 2 min left  mine 3\n'


@pytest.mark.parametrize(
    ('seconds', 'said'), [(41.6, '42 s'), (100.0, '2 min'), (6000.0, '1 h 40 min')]
)
def test_durations(seconds, said):
    assert duration(seconds) == said

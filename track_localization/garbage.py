"""Python's search for unused cycles of objects, and when it is in the way."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def paused() -> Iterator[None]:
    """
    Do not search for cycles meanwhile.

    An offline run keeps states and estimates by the hundred thousand, none of them in a cycle, and
    each search goes through them all: a third of the time of a filter over a ride.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()

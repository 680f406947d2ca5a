"""Replay as fast as the consumers keep up: a closed loop on the stamps that they give out."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from rclpy.node import Node

from track_localization.errors import DataError
from track_localization.ros import cdr
from track_localization.ros.qos import PACE_QOS

OPEN_RATE_HZ = 1000.0
"""Messages a second while the consumer tells nothing: what every node takes without loss."""
STEPS = 5
"""A pause in the stamps counts as 1 / STEPS of the window at most: see Progress."""
RESTART_NS = 5 * cdr.NANO
"""Stamps that go back further are not late, but begin anew."""
MOST_SENT = 10_000
"""Stamps kept for a consumer that tells nothing."""


class Progress:
    """
    How far a consumer is behind what was sent, in stamps without their pauses [ns].

    Pauses (a gap in the recording, a sensor at 1 Hz) are shortened to ``longest_ns``: the consumer
    cannot tell of a stamp before it has got the message, and a filter that publishes with one
    sensor never tells of the other's stamps.
    """

    def __init__(self, longest_ns: int) -> None:
        self._longest_ns = longest_ns
        self._sent: deque[tuple[int, int]] = deque(maxlen=MOST_SENT)
        """(stamp, place) of what was sent, from the newest that was consumed on."""

    def send(self, stamp_ns: int) -> bool:
        """Note a stamp that is sent; return False when time begins anew with it."""
        anew = bool(self._sent) and stamp_ns < self._sent[-1][0] - RESTART_NS
        if anew:
            self._sent.clear()
        if not self._sent or stamp_ns > self._sent[-1][0]:
            self._sent.append((stamp_ns, self._place(stamp_ns)))
        return not anew

    def consume(self, stamp_ns: int) -> None:
        """Note a stamp that the consumer gave out."""
        while len(self._sent) > 1 and self._sent[1][0] <= stamp_ns:
            self._sent.popleft()

    def behind_ns(self, stamp_ns: int | None = None) -> int:
        """Return how far behind the consumer is, or would be if this stamp were sent."""
        if not self._sent:
            return 0
        place = self._sent[-1][1] if stamp_ns is None else self._place(stamp_ns)
        return place - self._sent[0][1]

    def _place(self, stamp_ns: int) -> int:
        if not self._sent:
            return 0
        last_ns, place = self._sent[-1]
        return place + min(max(stamp_ns - last_ns, 0), self._longest_ns)


class Pace:
    """
    Tell when the next message may be sent.

    The consumer's progress is the stamp of its newest message on a topic. Until it has published
    (a filter waits for its start), and when it makes no progress for ``timeout_s``, messages go
    out at no more than ``OPEN_RATE_HZ``: slow, but no deadlock.
    """

    def __init__(self, node: Node, topic: str, window_s: float, timeout_s: float) -> None:
        self._node, self._topic = node, node.resolve_topic_name(topic)
        self._window_ns, self._timeout_s = round(window_s * cdr.NANO), timeout_s
        self._way = Progress(self._window_ns // STEPS)
        self._consumed_ns: int | None = None
        self._progress = self._next_open = time.monotonic()
        self._stalled = False

    def connect(self, spin: Callable[[float], None], deadline: float) -> None:
        """Find the topic and subscribe; raise DataError when nobody publishes it by then."""
        while not (found := self._node.get_publishers_info_by_topic(self._topic)):
            if time.monotonic() > deadline:
                raise DataError(
                    f'rate 0 goes by the progress on {self._topic}, which nobody publishes: start '
                    'the consumer, name its topic in pace_topic, or give a rate above 0'
                )
            spin(0.05)
        kind = cdr.message_class(found[0].topic_type)
        if kind is None or not cdr.has_header(kind):
            raise DataError(f'pace_topic {self._topic}: {found[0].topic_type} has no stamp')
        self._node.create_subscription(kind, self._topic, self._on_message, PACE_QOS, raw=True)

    def hold(self, stamp_ns: int, spin: Callable[[float], None]) -> None:
        """Wait, spinning, until a message with this stamp may be sent."""
        waiting_since = time.monotonic()
        while not self._may_send(stamp_ns):
            now = time.monotonic()
            idle = now - max(self._progress, waiting_since)
            if not self._stalled and self._consumed_ns is not None and idle > self._timeout_s:
                self._stalled = True
                self._node.get_logger().warning(
                    f'no progress on {self._topic} for {self._timeout_s:g} s: going on slowly'
                )
            if self._stalled or self._consumed_ns is None:
                if now >= self._next_open:
                    self._next_open = max(self._next_open, now - 0.01) + 1.0 / OPEN_RATE_HZ
                    break
                spin(min(self._next_open - now, 0.05))
            else:
                spin(0.05)
        if not self._way.send(stamp_ns):
            self._consumed_ns = None

    def drain(self, spin: Callable[[float], None], patience_s: float = 1.0) -> bool:
        """Wait until the consumer has reached what was sent; False if it stops well before."""
        self._progress = time.monotonic()
        while self._consumed_ns is None or self._way.behind_ns() > 0:
            if time.monotonic() - self._progress > patience_s:
                near = self._way.behind_ns() <= self._window_ns // STEPS
                return self._consumed_ns is not None and near
            spin(0.05)
        return True

    def _may_send(self, stamp_ns: int) -> bool:
        """Whether the consumer is near."""
        if self._consumed_ns is None or self._stalled:
            return False
        return self._way.behind_ns(stamp_ns) < self._window_ns

    def _on_message(self, raw: bytes) -> None:
        stamp_ns = cdr.header_ns(raw)
        if stamp_ns != self._consumed_ns:
            self._consumed_ns, self._progress = stamp_ns, time.monotonic()
            self._way.consume(stamp_ns)
            self._stalled = False

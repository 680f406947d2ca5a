"""Health of a node, once a second: rates, latency, what was accepted and rejected, and why."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from track_localization.ros.fast import advertise
from track_localization.ros.qos import OUTPUT_QOS

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
REMEDIES = {
    'empty_frame': 'the sender must set header.frame_id',
    'wrong_frame': 'set the frame_id of the sender, or the frame_... parameters of this node',
    'unknown_id': 'name the table of this line in the parameter balises',
    'backward_time': 'after a restarted recording, call ~/reset',
    'too_late': 'after a restarted recording, call ~/reset',
    'bad_stamp': 'the sender must stamp with the time of measurement',
}


class StampGaps:
    """
    Count the messages that never came, from the stamps of those that did.

    DDS loses silently. The usual interval is learnt from the stamps themselves; one of more than
    1.5 of it is a gap. When the rate changes for good, the new interval is taken over. A message
    that comes late, after newer ones, was counted as lost, and no longer is.
    """

    ADOPT_AFTER = 20
    LATE_S = 5.0
    """Further back than this is another recording, not a late message."""

    def __init__(self) -> None:
        self.gaps = 0
        self.lost = 0
        self._latest: float | None = None
        self._interval = 0.0
        self._odd = 0

    def add(self, time_s: float) -> None:
        """Take the stamp of a message that arrived [s]; backward ones are not judged."""
        if self._latest is not None and 0.0 < self._latest - time_s < self.LATE_S:
            self.lost = max(self.lost - 1, 0)
            return
        latest, self._latest = self._latest, time_s
        if latest is None or not 0.0 < (dt := time_s - latest) < 1e6:
            return
        if self._interval == 0.0:
            self._interval = dt
        elif dt > 1.5 * self._interval:
            self.gaps += 1
            self.lost += round(dt / self._interval) - 1
            self._settle(dt, True)
        elif dt < 0.5 * self._interval:
            self._settle(dt, True)
        else:
            self._settle(dt, False)

    def _settle(self, dt: float, odd: bool) -> None:
        self._odd = self._odd + 1 if odd else 0
        if self._odd >= self.ADOPT_AFTER:
            self._interval, self._odd = dt, 0
        elif not odd:
            self._interval += 0.05 * (dt - self._interval)


ANOTHER_CLOCK_S = 3600.0
"""A message that seems so late, or early, is stamped by another clock; its latency is unknown."""


class StreamHealth:
    """
    Counts of one sensor's messages since the start, and rates since the last report.

    ``now`` returns the node's time [s]; one message in 64 is asked how late it arrived. Where a
    stream has a better idea of its latency the node sets ``latency_s`` itself. ``expected``: its
    silence is worth a warning. ``regular``: its messages come at a rate, so that gaps can be told.
    ``why_silent``, where the node sets it, returns what is wrong with who should send, or ''.
    """

    def __init__(
        self, now: Callable[[], float] | None = None, expected: bool = True, regular: bool = True
    ) -> None:
        self.expected, self.regular = expected, regular
        self.why_silent: Callable[[], str] = lambda: ''
        self._now = now
        self.gaps = StampGaps()
        self.received = 0
        self.rejected: Counter[str] = Counter()
        self.latency_s = float('nan')
        self.busy_s = 0.0
        self._before = (0, 0, 0, 0.0)
        self._since = self._latest = float('nan')

    def arrived(self, time_s: float) -> None:
        """Note the stamp [s] of a message that could be read."""
        self.received += 1
        if self.regular:
            self.gaps.add(time_s)
        if not 0.0 < self._latest - time_s < StampGaps.LATE_S:
            self._latest = time_s
        if self._now is not None and self.received % 64 == 1:
            late = self._now() - time_s
            self.latency_s = late if abs(late) < ANOTHER_CLOCK_S else float('nan')
        if not self._since <= self._latest:
            self._since = self._latest

    def refused(self, reason: str) -> None:
        """Note a message that could not be read."""
        self.received += 1
        self.rejected[reason] += 1

    def report(
        self, name: str, wall_s: float, core_rejected: Mapping[str, int]
    ) -> tuple[bytes, str, dict[str, object]]:
        """Return level, message and figures over the ``wall_s`` seconds since the last report."""
        reasons = Counter(self.rejected) + Counter(dict(core_rejected))
        rejected = sum(reasons.values())
        now = (self.received, rejected, self.gaps.gaps, self.busy_s)
        new, refused, gaps, busy = (max(a - b, 0) for a, b in zip(now, self._before, strict=True))
        stamped = self._latest - self._since
        counted = new if self._before[0] else new - 1
        self._before, self._since = now, self._latest
        figures: dict[str, object] = {
            'received': self.received,
            'accepted': max(self.received - rejected, 0),
            'rejected': rejected,
            **{f'rejected.{reason}': n for reason, n in sorted(reasons.items())},
            'gaps': self.gaps.gaps,
            'lost': self.gaps.lost,
            'rate_hz': round(counted / stamped, 2) if stamped > 0.0 else 0.0,
            'arrivals_hz': round(new / wall_s, 2),
            'latency_s': round(self.latency_s, 4),
            'busy_percent': round(100.0 * busy / wall_s, 2),
        }
        # Of events one in a while may well be refused; all of them may not.
        hopeless = refused >= new if self.regular else rejected >= self.received
        if new and hopeless:
            worst = reasons.most_common(1)[0][0]
            remedy = REMEDIES.get(worst, '')
            text = f'{name}: all rejected ({worst}){": " + remedy if remedy else ""}'
            return ERROR, text, figures
        if refused > 0:
            return WARN, f'{name}: {refused} of {new} rejected', figures
        if gaps:
            return WARN, f'{name}: {gaps} gaps in the stamps', figures
        if not new and (why := self.why_silent()):
            return ERROR, f'{name}: {why}', figures
        if not new and self.expected:
            return WARN, f'{name}: no messages', figures
        return OK, f'{name}: ok', figures


class Diagnostics:
    """
    Publish ``/diagnostics`` at 1 Hz of wall time, whatever the node's clock does.

    ``streams`` are the node's sensors by name. ``core_rejected`` returns the counts of the core,
    sensor -> reason -> count; ``core_figures`` its other figures, those of a sensor as
    'figure.sensor' ('health.loop' other than 'ok' is worth a warning). Under simulated time the
    stamps are simulated, but health is still told when /clock stands still.
    """

    def __init__(
        self,
        node: Node,
        streams: dict[str, StreamHealth],
        core_rejected: Callable[[], Mapping[str, Mapping[str, int]]],
        core_figures: Callable[[], Mapping[str, float | str]],
    ) -> None:
        self._node, self._streams = node, streams
        self._core_rejected, self._core_figures = core_rejected, core_figures
        self._publisher = advertise(node, DiagnosticArray, '/diagnostics', OUTPUT_QOS)
        self._last_wall = time.monotonic()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(1.0, self.publish, clock=steady)

    def publish(self) -> None:
        """Publish one array: a status for the node's core and one for each sensor."""
        wall = max(time.monotonic() - self._last_wall, 1e-3)
        self._last_wall = time.monotonic()
        core, figures = self._core_rejected(), dict(self._core_figures())
        msg = DiagnosticArray()
        msg.header.stamp = self._node.get_clock().now().to_msg()
        levels = []
        for name, stream in self._streams.items():
            level, text, own = stream.report(name, wall, core.get(name, {}))
            for key in [key for key in figures if key.endswith(f'.{name}')]:
                own[key.removesuffix(f'.{name}')] = figures.pop(key)
            if level == OK and own.get('health', 'ok') != 'ok':
                level, text = WARN, f'{name}: {own["health"]}'
            levels.append((level, text))
            msg.status.append(self._status(name, level, text, own))
        level, text = max(levels, key=lambda item: item[0], default=(OK, 'ok'))
        text = str(figures.get('status', '')) or text
        msg.status.insert(0, self._status('', level, text, figures))
        self._publisher.publish(msg)

    def _status(
        self, part: str, level: bytes, text: str, figures: Mapping[str, object]
    ) -> DiagnosticStatus:
        name = self._node.get_fully_qualified_name().lstrip('/')
        return DiagnosticStatus(
            level=level,
            name=f'{name}: {part}' if part else name,
            message=text,
            hardware_id='track_localization',
            values=[KeyValue(key=k, value=str(v)) for k, v in figures.items()],
        )

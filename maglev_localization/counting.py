"""What the readings of a counter of crossings mean, and when a train stands; no estimation."""

from __future__ import annotations

import math
from typing import NamedTuple

from maglev_localization.config import LoopConfig
from maglev_localization.measurements import LoopPosition, RadarSpeed

STILL_AFTER_S, STILL_MPS, STILL_AGAIN_S = 1.0, 0.3, 0.2
"""A train whose count has not changed for so long, and whose radar reads less, stands; a filter is
told so every so often."""

STOOD_S = 3.0
"""A crossing after so long is a departure; sooner it may be the last one of a train that brakes."""

DEPARTURE_MPS2, DEPARTURE_LEAST_MPS2, UNSEEN_S = 1.5, 0.3, 5.0
"""How trains set out, the fastest and the slowest [m/s^2]; a longer silence is another matter."""

UNCHANGED_S, SLOW_MPS = 0.2, 1.0
"""A count that does not change is a measurement so often, while the train is slow [s], [m/s]."""

START_MPS, START_MPS2 = 30.0, 1.0
"""Speed and acceleration of a train at the start of a filter, 1 sigma: it may be under way."""

FROZEN_AFTER = 3

MOST_NIS, FAIR_NIS, PATIENCE = 9.0, 1.5, 0.02
MOST_DOUBT = 9.0
"""A surprise counts up to ``MOST_NIS``; where the mean is above ``FAIR_NIS`` a sensor's noise is
greater than it claims, and its logarithm follows by ``PATIENCE``, up to ``MOST_DOUBT``."""

IN_STEP, LOCKED_S, ALIKE_S, MOST_ALIKE = 0.25, 0.25, 0.5, 3.0
"""Part of a crossing within which readings are in step. They matter when they are for so long [s],
they are for at most so long, and so many times the variance of one is the most taken for that."""

ALIVE_S = 1.0
"""A sensor not heard for so long is silent [s]."""

SAME_M = 1e-6

UNEVEN, PITCHES, UNEVEN_MEMORY = 0.02, 100.0, 10.0
"""Part of a crossing that a change of the count may be off; only changes of so few crossings tell;
and of so many changes, more or less, most must be uneven before the readings are no counts."""


class Counting(NamedTuple):
    """
    What is remembered of the loop and the radar; times are stamps [s].

    Attributes:
        reading: the loop's last [m]; NaN before the first.
        sampled_s: its stamp.
        changed_s: of the last reading that differed from the one before.
        used_s: of the last reading that was a measurement.
        radar_mps: the radar's last speed [m/s].
        radar_s: its stamp.
        still_s: when a filter was last told that the train stands.
        radar_same: radar readings in a row that repeat the one before.
        uneven: share of the count's changes, of late, that were no whole crossings.
        heading: 1 or -1, the way in which the train ran last.
    """

    reading: float
    sampled_s: float
    changed_s: float
    used_s: float
    radar_mps: float
    radar_s: float
    still_s: float
    radar_same: int = 0
    uneven: float = 0.0
    heading: float = 1.0

    def unseen(self, z: RadarSpeed, least: float) -> tuple[float, float]:
        """
        Return how far [m] and how fast a train that stood may be unnoticed; 0 if it did not stand.

        A radar tells no speed below ``least`` [m/s], and none between its readings.
        """
        if not self.still_s > self.changed_s:
            return 0.0, 0.0
        elapsed = min(max(z.time_s - self.radar_s, 0.0), UNSEEN_S)
        gained = DEPARTURE_MPS2 * elapsed
        far = 0.5 * least * least / DEPARTURE_LEAST_MPS2 + 0.5 * gained * elapsed
        return math.copysign(far, z.speed), least + gained

    def runs(self, time_s: float) -> bool:
        """Whether a living radar says that the train moves."""
        alive = time_s - self.radar_s < ALIVE_S and not self.frozen
        return alive and abs(self.radar_mps) > STILL_MPS

    def counts(self, time_s: float, speed: float, pitch: float) -> bool:
        """Whether the count has changed of late as often as it does at ``speed`` [m/s] and more."""
        return self.changed_s > self.still_s and time_s - self.changed_s < pitch / speed

    def headed(self, speed: float, least: float) -> Counting:
        """Return the memory of a train that has this speed [m/s], told from ``least`` on."""
        return self if abs(speed) < least else self._replace(heading=math.copysign(1.0, speed))

    @property
    def frozen(self) -> bool:
        """Whether the radar repeats itself to the last digit, as no living one does."""
        return self.radar_same >= FROZEN_AFTER

    def pitch(self, loop: LoopConfig) -> float:
        """Return the pitch of the crossings [m]; 0 when the readings are not counts of them."""
        return loop.pitch_m if self.uneven < 0.5 else 0.0

    @classmethod
    def begin(cls, time_s: float) -> Counting:
        """Return the memory of a start."""
        nan = math.nan
        return cls(nan, nan, time_s, time_s, nan, nan, time_s)

    def still_sigma(self, time_s: float) -> float:
        """
        Return how well the speed is known to be zero [m/s]; 0 when it is not, or was told lately.

        A count that has stood for a time leaves room for half a crossing in that time.
        """
        stands = (
            time_s - self.changed_s > STILL_AFTER_S
            and time_s - self.sampled_s < ALIVE_S
            and time_s - self.radar_s < ALIVE_S
            and abs(self.radar_mps) < STILL_MPS
            and time_s - self.still_s > STILL_AGAIN_S
        )
        return max(0.1 / (time_s - self.changed_s), 0.02) if stands else 0.0


class Crossing(NamedTuple):
    """
    What a reading says: a true distance counted, within the pitch.

    Attributes:
        position: middle of what it may mean [m].
        variance: of that [m^2].
        crossings: passed since the reading before, at least 1.
        travel: distance since the last measurement [m].
        pitch: of the crossings [m]; 0 when the reading is no count.
        moved: whether the count changed; else it tells no more than these bounds.
        departed: the count had stood: nobody knows how far the train went unnoticed.
    """

    position: float
    variance: float
    crossings: float
    travel: float
    pitch: float
    moved: bool = True
    departed: bool = False


def hear(
    memory: Counting, z: LoopPosition, speed: float, loop: LoopConfig
) -> tuple[Counting, Crossing | None]:
    """
    Return the new memory, and what the reading says at the predicted ``speed`` [m/s], or None.

    A count that has just changed puts the train between that crossing and where it can be since
    the reading before; one that does not change says only that the next crossing was not reached.
    Readings that change by no whole crossings are distances, whatever the setting says.
    """
    speed, pitch = abs(speed), memory.pitch(loop)
    if math.isnan(memory.reading):
        first = Counting(
            z.reading, z.time_s, z.time_s, z.time_s, memory.radar_mps, memory.radar_s, z.time_s
        )
        variance = pitch * pitch / 12.0 + max(z.variance, loop.noise_m**2)
        return first, Crossing(z.reading + 0.5 * pitch, variance, 1.0, 0.0, pitch)
    change = z.reading - memory.reading
    moved = pitch == 0.0 or abs(change) > 0.5 * pitch
    elapsed = z.time_s - memory.sampled_s
    stood = z.time_s - memory.changed_s > STOOD_S and speed < SLOW_MPS
    departed = stood and moved and abs(change) < 1.5 * pitch
    spread = min(pitch, speed * elapsed) if moved else pitch
    memory = memory._replace(
        reading=z.reading,
        sampled_s=z.time_s,
        changed_s=z.time_s if moved else memory.changed_s,
        uneven=_unevenness(memory.uneven, change, loop.pitch_m),
    )
    runs = speed > SLOW_MPS or memory.runs(z.time_s)
    if not moved and (runs or z.time_s - memory.used_s <= UNCHANGED_S):
        return memory, None
    begin = z.reading if change >= 0.0 else z.reading + pitch - spread
    noise = max(z.variance - pitch * pitch / 12.0, loop.noise_m**2)
    in_step = _in_step(speed * elapsed, elapsed, pitch) if moved else 1.0
    crossing = Crossing(
        position=begin + 0.5 * spread,
        variance=in_step * spread * spread / 12.0 + noise,
        crossings=max(speed * elapsed / pitch, 1.0) if pitch > 0.0 else 1.0,
        travel=speed * (z.time_s - memory.used_s) + pitch,
        pitch=pitch,
        moved=moved,
        departed=departed,
    )
    return memory._replace(used_s=z.time_s), crossing


def _in_step(travel: float, elapsed: float, pitch: float) -> float:
    """
    Return how many readings share one error of rounding, at a ``travel`` [m] from one to the next.

    Where that is nearly a whole number of crossings, they are rounded alike for many readings: no
    mean over them is nearer to the truth than one. Beyond ``MOST_ALIKE`` a crossing missed could no
    longer be told.
    """
    if pitch == 0.0 or travel < 0.5 * pitch:
        return 1.0
    off = abs(travel / pitch - round(travel / pitch))
    alike = IN_STEP / max(off, 1e-6)
    if alike * elapsed < LOCKED_S:
        return 1.0
    return max(min(alike, ALIKE_S / elapsed, MOST_ALIKE), 1.0)


def doubted(doubt: float, nis: float, strange: bool) -> float:
    """
    Return the logarithm of how much greater a sensor's variance is than it claims, after a reading.

    It has a ``nis`` under that variance; or it is ``strange``: no noise explains it.
    """
    surprise = MOST_NIS if strange else min(nis, MOST_NIS)
    if math.isnan(surprise):
        return doubt
    return min(max(doubt + PATIENCE * (surprise - FAIR_NIS), 0.0), MOST_DOUBT)


def _unevenness(before: float, change: float, pitch: float) -> float:
    """Return the share of uneven changes after one more change of the count [m]."""
    if pitch == 0.0 or not SAME_M < abs(change) < PITCHES * pitch:
        return before
    crossings = change / pitch
    return before + ((abs(crossings - round(crossings)) > UNEVEN) - before) / UNEVEN_MEMORY


def hear_radar(memory: Counting, z: RadarSpeed) -> Counting:
    """Return the memory after a radar reading."""
    same = z.speed == memory.radar_mps and abs(z.speed) > STILL_MPS
    return memory._replace(
        radar_mps=z.speed, radar_s=z.time_s, radar_same=memory.radar_same + 1 if same else 0
    )

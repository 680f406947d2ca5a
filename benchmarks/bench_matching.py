"""
Time and memory of the warping algorithms against dtaidistance's C, in one run, same series.

dtaidistance computes plain DTW with its full path; so does ours. SRDTW (exact, seven
recombinations, derivative, global penalty) is held against dtaidistance's *plain* DTW. The series
are smooth random rides at 100 Hz with a pace that wanders. Prints ratios; asks nothing.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from dtaidistance import dtw as reference
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from coaster_localization import dtw, srdtw
from coaster_localization.segments import matched_cut_points

Array = NDArray[np.float64]

RATE_HZ = 100.0


def ride_pair(count: int, seed: int = 1) -> tuple[Array, Array]:
    """Return z-scored (measured, design) series (count,), a turning point every 1.4 s or so."""
    rng = np.random.default_rng(seed)
    design = gaussian_filter1d(rng.normal(size=count + 400), 0.45 * RATE_HZ)[200:-200]
    pace = 1.0 + 0.05 * gaussian_filter1d(rng.normal(size=count), 500.0) * np.sqrt(500.0 * 3.5)
    warped = np.cumsum(pace)
    warped = (warped - warped[0]) * (count - 1) / (warped[-1] - warped[0])
    noise = gaussian_filter1d(rng.normal(size=count), 0.2 * RATE_HZ) * np.sqrt(RATE_HZ * 0.7)
    measured = np.interp(warped, np.arange(count), design / design.std()) + 0.15 * noise
    return (measured - measured.mean()) / measured.std(), design / design.std()


def ours_plain(a: Array, b: Array) -> None:
    """Plain DTW, full path."""
    dtw.align(a, b)


def ours_srdtw(a: Array, b: Array) -> None:
    """SRDTW as the paper: cuts, derivative, exact program, joined point path."""
    cuts_a, cuts_b = matched_cut_points(a, b, 0.4)
    features = [dtw.with_derivative(x[:, None], RATE_HZ, 0.2) for x in (a, b)]
    found = srdtw.align_segments(
        features[0], features[1], cuts_a, cuts_b, RATE_HZ, srdtw.GlobalPenalty()
    )
    if found is None:
        raise SystemExit('bench: the series cannot be recombined; take another seed')


def theirs(a: Array, b: Array) -> None:
    """Plain DTW of dtaidistance's C, full path."""
    reference.warping_path_fast(a, b)


METHODS: dict[str, Callable[[Array, Array], None]] = {
    'dtw': ours_plain,
    'srdtw': ours_srdtw,
    'dtaidistance': theirs,
}


def best_seconds(run: Callable[[Array, Array], None], a: Array, b: Array, times: int) -> float:
    """Return the best wall time of several runs; the first, which may compile, is not counted."""
    run(a[:300], b[:300]) if run is not ours_srdtw else run(a, b)
    seconds = []
    for _ in range(times):
        begin = time.perf_counter()
        run(a, b)
        seconds.append(time.perf_counter() - begin)
    return min(seconds)


def peak_growth_mib(name: str, count: int) -> float:
    """Return by how much a run raises the peak memory of a process of its own [MiB]."""
    command = [sys.executable, __file__, '--memory', name, str(count)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def report_memory(name: str, count: int) -> None:
    """Print the growth of the peak resident size over a run, warmed up on short series."""
    a, b = ride_pair(count)
    METHODS[name](a[:1500], b[:1500])
    before = peak_kib()
    METHODS[name](a, b)
    print((peak_kib() - before) / 1024.0)


def peak_kib() -> int:
    """Return this process's peak resident size [KiB] (Linux; not inherited, as getrusage's is)."""
    lines = Path('/proc/self/status').read_text(encoding='ascii').splitlines()
    return int(next(line for line in lines if line.startswith('VmHWM')).split()[1])


def main() -> None:
    """Print the table."""
    n = 6000
    a, b = ride_pair(n)
    seconds = {name: best_seconds(METHODS[name], a, b, 5) for name in ('dtw', 'dtaidistance')}
    mib = {name: peak_growth_mib(name, n) for name in ('dtw', 'dtaidistance')}
    ratio = seconds['dtaidistance'] / seconds['dtw']
    print(f'plain DTW, full path, n = {n}')
    for name in seconds:
        print(f'  {name:13s} {1e3 * seconds[name]:8.1f} ms {mib[name]:8.1f} MiB')
    print(f'  {ratio:.1f} x as fast, {mib["dtw"] / mib["dtaidistance"]:.3f} of the memory')
    print('SRDTW, exact, against dtaidistance plain DTW, rides at 100 Hz')
    for ride_s, times in ((67, 3), (105, 3), (190, 2)):
        a, b = ride_pair(int(ride_s * RATE_HZ))
        ours, other = best_seconds(ours_srdtw, a, b, times), best_seconds(theirs, a, b, times)
        print(
            f'  {ride_s:4d} s: srdtw {1e3 * ours:7.1f} ms, dtaidistance {1e3 * other:7.1f} ms, '
            f'{other / ours:.1f} x as fast'
        )


if __name__ == '__main__':
    if sys.argv[1:2] == ['--memory']:
        report_memory(sys.argv[2], int(sys.argv[3]))
    else:
        main()

"""Everything that can be set on a simulated train run."""

from __future__ import annotations

import dataclasses

from track_localization.settings import setting
from track_localization.sim.train.grades import GRADES

DAY_S = 86400.0
AS_GRADE = -1.0
"""Value of an IMU setting that leaves the figure to the grade."""


@dataclasses.dataclass(frozen=True)
class Line:
    """The line: curves with transitions, grades with vertical curves, cant."""

    latitude_deg: float = setting(40.3458, 'deg', 'where trains start', -80.0, 80.0)
    longitude_deg: float = setting(116.0271, 'deg', 'where trains start', -180.0, 180.0)
    height_m: float = setting(500.0, 'm', 'above the ellipsoid there', -500.0, 9000.0)
    course_deg: tuple[float, float] = setting(
        (100.0, 170.0), 'deg', 'course at its beginning, from east to north, uniform', -360.0, 360.0
    )
    lead_m: float = setting(500.0, 'm', 'of line before the start and after the end', 50.0, 1e5)
    radius_m: tuple[float, float] = setting((2200.0, 6000.0), 'm', 'of curves, uniform', 200.0, 1e6)
    turn_deg: tuple[float, float] = setting(
        (8.0, 30.0), 'deg', 'by so much a curve turns, uniform', 0.5, 180.0
    )
    transition_m: tuple[float, float] = setting(
        (250.0, 400.0), 'm', 'length of transitions, uniform', 10.0, 2000.0
    )
    straight_m: tuple[float, float] = setting(
        (200.0, 1200.0), 'm', 'between curves, uniform', 0.0, 1e6
    )
    grade: float = setting(0.025, '', 'steepest slope, either way', 0.0, 0.1)
    grade_m: tuple[float, float] = setting(
        (900.0, 2500.0), 'm', 'distance of changes of slope, uniform', 200.0, 1e6
    )
    vertical_radius_m: float = setting(20000.0, 'm', 'sharpest vertical curve', 1000.0, 1e6)
    cant_deg: float = setting(6.0, 'deg', 'greatest cant', 0.0, 15.0)
    cant_share: float = setting(0.7, '', 'share of the balancing cant at full speed', 0.0, 1.5)


@dataclasses.dataclass(frozen=True)
class Rails:
    """How rails deviate from the line as set out, in long waves."""

    aside_m: float = setting(0.0015, 'm', 'rms sideways', 0.0, 0.1)
    above_m: float = setting(0.0015, 'm', 'rms upward', 0.0, 0.1)
    cross_m: float = setting(0.001, 'm', 'rms of one rail above the other', 0.0, 0.1)
    gauge_m: float = setting(1.5, 'm', 'distance of the rails', 0.5, 3.0)
    wave_m: tuple[float, float] = setting((25.0, 150.0), 'm', 'lengths of waves', 5.0, 1e4)


@dataclasses.dataclass(frozen=True)
class Running:
    """How the train runs."""

    profile: str = setting(
        'stops',
        '',
        'stops: from station to station; underway: distance_m in duration_s, never standing',
        choices=('stops', 'underway'),
    )
    speed_mps: tuple[float, float] = setting(
        (50.0, 65.0), 'm/s', 'stops: cruising speeds, uniform', 1.0, 150.0
    )
    stand_s: float = setting(60.0, 's', 'stops: standstill before the first departure', 0.0, DAY_S)
    dwell_s: tuple[float, float] = setting((30.0, 60.0), 's', 'stops: at stations', 0.0, DAY_S)
    legs: int = setting(3, '', 'stops: how many', 1, 1000)
    leg_m: tuple[float, float] = setting((9e3, 13e3), 'm', 'stops: their lengths', 50.0, 1e6)
    acceleration_mps2: float = setting(0.6, 'm/s^2', 'greatest, in starting', 0.05, 5.0)
    braking_mps2: float = setting(0.7, 'm/s^2', 'greatest, in braking', 0.05, 5.0)
    jerk_mps3: float = setting(0.3, 'm/s^3', 'stops: greatest', 0.01, 10.0)
    distance_m: float = setting(11e3, 'm', 'underway: in all', 10.0, 1e6)
    duration_s: float = setting(200.0, 's', 'underway: in all', 1.0, DAY_S)
    variation: float = setting(0.1, '', 'underway: of the speed about its mean', 0.0, 0.9)
    phase_s: float = setting(50.0, 's', 'underway: between changes of speed', 5.0, DAY_S)


@dataclasses.dataclass(frozen=True)
class Terrain:
    """What covers the sky along the line."""

    tunnels: tuple[int, int] = setting((3, 5), '', 'how many, uniform', 0, 1000)
    tunnel_m: tuple[float, float] = setting((400.0, 3000.0), 'm', 'their lengths', 1.0, 1e5)
    cuttings: tuple[int, int] = setting((3, 5), '', 'how many, uniform', 0, 1000)
    cutting_m: tuple[float, float] = setting((200.0, 1200.0), 'm', 'their lengths', 1.0, 1e5)
    cutting_hdop: tuple[float, float] = setting(
        (2.5, 9.0), '', 'mean HDOP of a cutting, uniform', 0.5, 99.0
    )
    mouth_m: float = setting(150.0, 'm', 'half covered, on either side of tunnels', 0.0, 1e4)
    mouth_hdop: float = setting(2.2, '', 'HDOP there', 0.5, 99.0)
    open_hdop: tuple[float, float] = setting((0.8, 1.2), '', 'HDOP under open sky', 0.5, 99.0)
    open_satellites: tuple[int, int] = setting((8, 14), '', 'satellites under it', 4, 60)
    wander_s: float = setting(120.0, 's', 'correlation time of HDOP and count', 1.0, 1e5)


@dataclasses.dataclass(frozen=True)
class ImuErrors:
    """The IMU; -1 leaves a figure to the grade."""

    grade: str = setting('industrial', '', 'what it costs', choices=tuple(GRADES))
    rate_hz: float = setting(100.0, 'Hz', 'sampling rate', 5.0, 2000.0)
    gyro_bias_dph: float = setting(AS_GRADE, 'deg/h', 'gyro bias, N(0, this)', AS_GRADE, 1e5)
    angle_walk: float = setting(AS_GRADE, 'deg/sqrt(h)', 'white noise of gyros', AS_GRADE, 1e3)
    accel_bias_mg: float = setting(AS_GRADE, 'mg', 'bias, N(0, this)', AS_GRADE, 1e3)
    velocity_walk: float = setting(
        AS_GRADE, 'm/s/sqrt(h)', 'white noise of accelerometers', AS_GRADE, 1e3
    )
    gyro_in_run_dph: float = setting(AS_GRADE, 'deg/h', 'rms of the wandering', AS_GRADE, 1e4)
    accel_in_run_mg: float = setting(AS_GRADE, 'mg', 'rms of the wandering', AS_GRADE, 1e3)
    in_run_s: float = setting(300.0, 's', 'correlation time of both', 1.0, 1e6)


@dataclasses.dataclass(frozen=True)
class Start:
    """The pose that an aligned start is told."""

    given: bool = setting(False, '', 'whether it is told at all')
    level_deg: float = setting(AS_GRADE, 'deg', 'roll, pitch: N(0, this); -1: grade', AS_GRADE, 90)
    yaw_deg: float = setting(AS_GRADE, 'deg', 'N(0, this); -1: as the grade', AS_GRADE, 180.0)
    horizontal_m: float = setting(0.85, 'm', 'east, north: N(0, this)', 0.0, 1e4)
    vertical_m: float = setting(1.6, 'm', 'up: N(0, this)', 0.0, 1e4)


@dataclasses.dataclass(frozen=True)
class GnssErrors:
    """The receiver; position errors are those at HDOP 1 and grow with it."""

    rate_hz: float = setting(1.0, 'Hz', 'fixes', 0.01, 100.0)
    outage_s: tuple[float, float] = setting(
        (0.0, 0.0), 's', 'no satellites from, to, after the start', 0.0, DAY_S
    )
    drift_m: float = setting(0.8, 'm', 'rms of the correlated part, east and north', 0.0, 100.0)
    drift_up_m: float = setting(1.5, 'm', 'rms of it, up', 0.0, 100.0)
    drift_s: tuple[float, float] = setting(
        (200.0, 600.0), 's', 'its correlation time, uniform per run', 1.0, 1e5
    )
    noise_m: float = setting(0.3, 'm', 'white noise, east and north', 0.0, 100.0)
    noise_up_m: float = setting(0.5, 'm', 'white noise, up', 0.0, 100.0)
    outliers: float = setting(0.02, '', 'share of fixes by multipath', 0.0, 1.0)
    outliers_covered: float = setting(0.1, '', 'in cuttings and at tunnel mouths', 0.0, 1.0)
    outlier_m: tuple[float, float] = setting(
        (3.0, 80.0), 'm', 'length of their error, uniform in its logarithm', 0.01, 1e5
    )
    held_up_m: float = setting(
        10.0, 'm', 'claimed of a height that is held for want of a fourth satellite', 0.0, 1e4
    )
    search_s: tuple[float, float] = setting(
        (0.5, 3.0), 's', 'until the first fix after a tunnel, uniform', 0.0, 600.0
    )
    lever_m: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), 'm', 'antenna from the IMU: ahead, left, up', -100.0, 100.0
    )
    latency_s: tuple[float, float] = setting((0.05, 0.15), 's', 'uniform per fix', 0.0, 60.0)


@dataclasses.dataclass(frozen=True)
class OdometerErrors:
    """The odometer."""

    rate_hz: float = setting(10.0, 'Hz', 'readings', 0.1, 1000.0)
    scale: float = setting(0.002, '', 'scale factor error', 0.0, 0.5)
    scale_law: str = setting(
        'sign', '', 'sign: this or minus this; uniform: between them', choices=('sign', 'uniform')
    )
    noise_m: float = setting(0.005, 'm', 'white noise per reading', 0.0, 1.0)
    pulse_m: float = setting(0.02, 'm', 'way of a pulse', 1e-5, 10.0)
    mount_deg: float = setting(0.3, 'deg', 'yaw, pitch against the IMU, N(0, this)', 0.0, 20.0)
    slips: float = setting(8.0, '', 'slips and slides outside outages, mean number', 0.0, 1e4)
    slips_in_outage: tuple[int, int] = setting((0, 1), '', 'in each outage, uniform', 0, 1000)
    slip_share: tuple[float, float] = setting((0.03, 0.2), '', 'of the speed, uniform', 0.0, 1.0)
    slip_s: tuple[float, float] = setting((0.5, 4.0), 's', 'their lengths, uniform', 0.05, 600.0)
    slip_rise_s: float = setting(0.2, 's', 'until a slip is full, and for its end', 0.0, 10.0)
    latency_s: tuple[float, float] = setting((0.005, 0.02), 's', 'uniform each', 0.0, 60.0)


@dataclasses.dataclass(frozen=True)
class Survey:
    """How ``track.csv`` differs from the line."""

    given: bool = setting(True, '', 'whether there is one')
    row_m: float = setting(5.0, 'm', 'distance of rows', 0.5, 100.0)
    cross_m: tuple[float, float] = setting((0.2, 0.4), 'm', 'rms sideways, uniform', 0.0, 100.0)
    height_m: tuple[float, float] = setting((0.1, 0.3), 'm', 'rms of height, uniform', 0.0, 100.0)
    correlation_m: float = setting(400.0, 'm', 'of both', 20.0, 1e5)
    aside_m: float = setting(0.0, 'm', 'the whole of it, to the left', -1000.0, 1000.0)


@dataclasses.dataclass(frozen=True)
class Faults:
    """Bad data, each switched on alone; all off."""

    nan: float = setting(0.0, '', 'share of samples of every sensor that are NaN', 0.0, 1.0)
    time_jumps: int = setting(0, '', 'spells of wrong stamps in each sensor', 0, 1000)
    time_jump_s: float = setting(100.0, 's', 'by so much, either way', 0.0, 900.0)
    imu_gap_s: float = setting(0.0, 's', 'length of a gap in the IMU samples', 0.0, DAY_S)
    stuck_s: float = setting(0.0, 's', 'the odometer repeats its speed for so long', 0.0, DAY_S)
    gnss_outlier_m: float = setting(0.0, 'm', 'error of three fixes in a row', 0.0, 1e6)
    no_covariance: bool = setting(False, '', 'fixes without covariance')
    stale_no_fix: bool = setting(False, '', 'no-fix messages repeat the last coordinates')
    no_hdop: bool = setting(False, '', 'HDOP is not told')
    no_quality: bool = setting(False, '', 'neither HDOP nor satellites are told')
    no_wheel: bool = setting(False, '', 'there is no odometer')


@dataclasses.dataclass(frozen=True)
class Clock:
    """The recording's clock."""

    start_s: float = setting(1000.0, 's', 'at the start', 1000.0, 1e9)
    truth_rate_hz: float = setting(100.0, 'Hz', 'of the truth', 1.0, 2000.0)
    staggered: bool = setting(True, '', 'odometer and GNSS at phases of their own')


@dataclasses.dataclass(frozen=True)
class TrainSimConfig:
    """Everything that can be set on a simulated run."""

    line: Line = Line()
    rails: Rails = Rails()
    motion: Running = Running()
    terrain: Terrain = Terrain()
    imu: ImuErrors = ImuErrors()
    start: Start = Start()
    gnss: GnssErrors = GnssErrors()
    odometer: OdometerErrors = OdometerErrors()
    survey: Survey = Survey()
    faults: Faults = Faults()
    clock: Clock = Clock()

"""`RecordedDrive`: a stretch of a log in which a car drives, on an even time grid for a replay.

Axes: x forward, y left, z up; positive roll lowers the right side.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from offline.logs.mapping import LogMapping
from offline.logs.signal import LoggedDrive, Stretch, find_stretches, grid, resample, runs
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError, DatasetError
from sim_bridge.plant.protocol import FASTEST_START_MPS

PERIOD_S = 0.01
LEAST_SPEED_MPS, SHORTEST_S = 2.0, 5.0
SPEED = "vx_mps"
STEERING = ("steer_rad", "road_wheel_rad")
COMPARED = ("yaw_rate_radps", "vy_mps", "ay_mps2", "accelerometer_left_mps2", "roll_rad")
"""signals of which a mapping has at least one; with the lateral velocity of the centre of gravity,
its lateral acceleration, and the reading of an accelerometer fixed to the body there"""


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """A drive in SI units, every `PERIOD_S`."""

    name: str
    speed_mps: Array
    """(n,)"""
    steer_rad: Array
    """(n,) angle of the steering wheel, or of the road wheels without compliance"""
    is_road_wheel: bool
    signals: dict[str, Array]
    """(n,) each, those of `COMPARED` that the log contains"""


def require_signals(path: Path, mapping: LogMapping) -> None:
    """Return if a mapping has speed, steering and a signal to compare.

    Raises:
        ConfigError: it has not, or two angles of the steering.
    """
    names = set(mapping.read_signals)
    for wanted, found, most in (
        (f"the speed, {SPEED}", {SPEED} & names, 1),
        (f"either {' or '.join(STEERING)}", names.intersection(STEERING), 1),
        (f"one of {', '.join(COMPARED)} to compare with", names.intersection(COMPARED), 9),
    ):
        if not 0 < len(found) <= most:
            raise ConfigError(
                f"{path}: expected {wanted}, found {' and '.join(sorted(found)) or 'none'}. Name "
                f"the signals so in [states], [inputs] or [checks.signals]."
            )


def recorded_drives(drive: LoggedDrive) -> list[RecordedDrive]:
    """The stretches of a log in which the car drives forward and all that is needed is known.

    Args:
        drive: of a mapping that passes `require_signals`; its other signals may have gaps.

    Raises:
        DatasetError: no stretch lasts `SHORTEST_S`.
    """
    used = {SPEED, *STEERING, *COMPARED}
    drive = drive._replace(signals=tuple(s for s in drive.signals if s.name in used), poses=())
    parts = list(_driven(drive, find_stretches(drive)))
    longest_s = max((PERIOD_S * (len(part["t_s"]) - 1) for part in parts), default=0.0)
    if longest_s < SHORTEST_S:
        raise DatasetError(
            f"{drive.name}: expected at least {SHORTEST_S:g} s without gap at "
            f"{LEAST_SPEED_MPS:g} to {FASTEST_START_MPS:g} m/s, found {longest_s:.3g} s. Correct "
            f"the units in the mapping, or what cuts the log: longest_gap_s, keep, steepest_per_s."
        )
    kept = [part for part in parts if PERIOD_S * (len(part["t_s"]) - 1) >= SHORTEST_S]
    return [_to_recorded(drive.name, part, len(kept) > 1) for part in kept]


def _driven(drive: LoggedDrive, stretches: Sequence[Stretch]) -> Iterator[dict[str, Array]]:
    """Times and signals (n,) of each part in which the speed is one that can be replayed."""
    for stretch in stretches:
        t_s = grid(stretch, PERIOD_S)
        signals = {each.name: resample(each, stretch, t_s, PERIOD_S) for each in drive.signals}
        speed_mps = signals[SPEED]
        for begin, end in runs((speed_mps >= LEAST_SPEED_MPS) & (speed_mps <= FASTEST_START_MPS)):
            part = {name: values[begin:end] for name, values in signals.items()}
            yield {"t_s": t_s[begin:end], **part}


def _to_recorded(name: str, part: dict[str, Array], is_one_of_several: bool) -> RecordedDrive:
    (steering,) = (each for each in STEERING if each in part)
    return RecordedDrive(
        f"{name} from {part['t_s'][0]:.1f} s" if is_one_of_several else name,
        part[SPEED],
        part[steering],
        steering == "road_wheel_rad",
        {each: part[each] for each in COMPARED if each in part},
    )

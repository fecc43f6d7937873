"""Units that other people's variables come in, and what they are in SI."""

from dataclasses import dataclass

from rt_controller.contract.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Unit:
    """One unit: what it measures, and how many of the SI unit it is."""

    dimension: str
    to_si: float


_DEGREE = 0.017453292519943295
_RPM = 0.10471975511965977
_GRAVITY = 9.80665

_UNITS = {
    "1": Unit("ratio", 1.0),
    "%": Unit("ratio", 0.01),
    "m/s": Unit("speed", 1.0),
    "km/h": Unit("speed", 1.0 / 3.6),
    "mm": Unit("length", 1e-3),
    "m": Unit("length", 1.0),
    "rad": Unit("angle", 1.0),
    "deg": Unit("angle", _DEGREE),
    "rad/s": Unit("angular speed", 1.0),
    "deg/s": Unit("angular speed", _DEGREE),
    "rpm": Unit("angular speed", _RPM),
    "rev/min": Unit("angular speed", _RPM),
    "m/s2": Unit("acceleration", 1.0),
    "m/s^2": Unit("acceleration", 1.0),
    "g": Unit("acceleration", _GRAVITY),
    "N": Unit("force", 1.0),
    "kN": Unit("force", 1e3),
    "N.m": Unit("torque", 1.0),
    "Nm": Unit("torque", 1.0),
    "Pa": Unit("pressure", 1.0),
    "kPa": Unit("pressure", 1e3),
    "MPa": Unit("pressure", 1e6),
    "bar": Unit("pressure", 1e5),
}


_DIMENSIONS = {
    (0, 0, 0, 0): "ratio",
    (0, 1, 0, 0): "length",
    (0, 1, -1, 0): "speed",
    (0, 1, -2, 0): "acceleration",
    (0, 0, 0, 1): "angle",
    (0, 0, -1, 1): "angular speed",
    (0, 0, -1, 0): "angular speed",
    (1, 1, -2, 0): "force",
    (1, 2, -2, 0): "torque",
    (1, -1, -2, 0): "pressure",
}
"""by the exponents of kg, m, s and rad"""


def unit_of_exponents(kg: int, m: int, s: int, rad: int, to_si: float) -> Unit | None:
    """The unit that a model description spells out in base units; None where none is known."""
    dimension = _DIMENSIONS.get((kg, m, s, rad))
    return None if dimension is None else Unit(dimension, to_si)


def find_unit(text: str) -> Unit | None:
    """The unit of that spelling; None where it is not known."""
    return _UNITS.get(text)


def require_unit(text: str, where: str) -> Unit:
    """The unit of that spelling.

    Raises:
        ConfigError: it is not known.
    """
    unit = find_unit(text)
    if unit is None:
        raise ConfigError(
            f"{where}: expected one of the units {', '.join(_UNITS)}, found {text!r}. Name one of "
            f"them and put the rest into scale."
        )
    return unit

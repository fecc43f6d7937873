"""`unit_of`: the FMI unit of a signal or parameter, read from the end of its name.

unit_of("yaw_rate_radps").name      # "rad/s"
unit_of("pedal_mpa_per_n")          # MPa/N: kg^0 m^-3 ..., factor 1e6
"""

from math import pi
from typing import NamedTuple


class FmuUnit(NamedTuple):
    """A unit: value in SI base units = factor * value."""

    name: str
    kg: int = 0
    m: int = 0
    s: int = 0
    rad: int = 0
    factor: float = 1.0


class DisplayUnit(NamedTuple):
    """A unit for people: displayed value = factor * value."""

    name: str
    factor: float


NO_UNIT = FmuUnit("1")
_ENDINGS = {
    "m": FmuUnit("m", m=1),
    "m2": FmuUnit("m2", m=2),
    "m3": FmuUnit("m3", m=3),
    "s": FmuUnit("s", s=1),
    "ms": FmuUnit("ms", s=1, factor=1e-3),
    "rad": FmuUnit("rad", rad=1),
    "deg": FmuUnit("deg", rad=1, factor=pi / 180.0),
    "kg": FmuUnit("kg", kg=1),
    "kgm2": FmuUnit("kg.m2", kg=1, m=2),
    "kgpm3": FmuUnit("kg/m3", kg=1, m=-3),
    "mps": FmuUnit("m/s", m=1, s=-1),
    "mps2": FmuUnit("m/s2", m=1, s=-2),
    "radps": FmuUnit("rad/s", rad=1, s=-1),
    "radps2": FmuUnit("rad/s2", rad=1, s=-2),
    "radpm": FmuUnit("rad/m", rad=1, m=-1),
    "rpm": FmuUnit("rpm", rad=1, s=-1, factor=pi / 30.0),
    "krpm": FmuUnit("krpm", rad=1, s=-1, factor=1000.0 * pi / 30.0),
    "spm": FmuUnit("s/m", s=1, m=-1),
    "n": FmuUnit("N", kg=1, m=1, s=-2),
    "kn": FmuUnit("kN", kg=1, m=1, s=-2, factor=1e3),
    "nm": FmuUnit("N.m", kg=1, m=2, s=-2),
    "nms": FmuUnit("N.m.s", kg=1, m=2, s=-1),
    "npm": FmuUnit("N/m", kg=1, s=-2),
    "nspm": FmuUnit("N.s/m", kg=1, s=-1),
    "npr": FmuUnit("N/rad", kg=1, m=1, s=-2, rad=-1),
    "nprad": FmuUnit("N/rad", kg=1, m=1, s=-2, rad=-1),
    "nmprad": FmuUnit("N.m/rad", kg=1, m=2, s=-2, rad=-1),
    "nmsprad": FmuUnit("N.m.s/rad", kg=1, m=2, s=-1, rad=-1),
    "pa": FmuUnit("Pa", kg=1, m=-1, s=-2),
    "mpa": FmuUnit("MPa", kg=1, m=-1, s=-2, factor=1e6),
    "w": FmuUnit("W", kg=1, m=2, s=-3),
    "kw": FmuUnit("kW", kg=1, m=2, s=-3, factor=1e3),
    "j": FmuUnit("J", kg=1, m=2, s=-2),
    "hz": FmuUnit("Hz", s=-1),
}
"""by the last word of a name; a name that ends otherwise is a number without unit"""

_OF_TYRE_FILES = {"fnomin": _ENDINGS["n"], "unloaded_radius": _ENDINGS["m"]}
"""names of `.tir` files that have units; the other coefficients have none"""

_DISPLAY = {
    "rad": DisplayUnit("deg", 180.0 / pi),
    "rad/s": DisplayUnit("deg/s", 180.0 / pi),
    "m/s": DisplayUnit("km/h", 3.6),
    "rad/m": DisplayUnit("deg/m", 180.0 / pi),
}


def unit_of(name: str) -> FmuUnit:
    """The unit of a name such as `brake_n`, `drag_nm_per_krpm`, `capacity_nm_per_rpm2`."""
    if name in _OF_TYRE_FILES:
        return _OF_TYRE_FILES[name]
    before, separator, after = name.rpartition("_per_")
    if not separator:
        return _ending(name)
    below = _power(after)
    return NO_UNIT if below is None else _divided(_ending(before), below)


def display_unit_of(unit: FmuUnit) -> DisplayUnit | None:
    """A unit for people; None if it is the unit itself."""
    return _DISPLAY.get(unit.name)


def words_of(name: str) -> str:
    """The name in words, without its unit."""
    before, separator, after = name.rpartition("_per_")
    core = before if separator and _power(after) is not None else name
    first, *words = core.split("_")
    if words and _unit(words[-1]):
        words = words[:-1]
    elif _ending(core) != NO_UNIT:
        words = [*words[:-2], words[-1]]
    return " ".join((first, *words))


def _ending(name: str) -> FmuUnit:
    """The unit at the end of a name, or before one last word: `up_rpm_full`."""
    _, *words = name.split("_")
    if words and _unit(words[-1]):
        return _unit(words[-1]) or NO_UNIT
    before = words[-2] if len(words) > 1 else ""
    return _ENDINGS.get(before, NO_UNIT) if len(before) > 1 else NO_UNIT


def _unit(ending: str) -> FmuUnit | None:
    """A unit of the table, or the quotient of two of them: `radpnm` is rad/(N.m)."""
    if ending in _ENDINGS:
        return _ENDINGS[ending]
    for i, letter in enumerate(ending):
        above, below = ending[:i], ending[i + 1 :]
        if letter == "p" and above in _ENDINGS and below in _ENDINGS:
            return _divided(_ENDINGS[above], _ENDINGS[below])
    return None


def _power(name: str) -> FmuUnit | None:
    """A unit below the fraction line, such as `n` or `rpm2`."""
    if name in _ENDINGS:
        return _ENDINGS[name]
    base, power = name[:-1], name[-1:]
    if base not in _ENDINGS or not power.isdigit():
        return None
    one, times = _ENDINGS[base], int(power)
    exponents = (times * one.kg, times * one.m, times * one.s, times * one.rad)
    return FmuUnit(f"{one.name}{power}", *exponents, one.factor**times)


def _divided(above: FmuUnit, below: FmuUnit) -> FmuUnit:
    is_single = below.name.isalnum()
    name = f"{above.name}/{below.name}" if is_single else f"{above.name}/({below.name})"
    return FmuUnit(
        name,
        above.kg - below.kg,
        above.m - below.m,
        above.s - below.s,
        above.rad - below.rad,
        above.factor / below.factor,
    )

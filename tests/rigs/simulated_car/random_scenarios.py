"""Random content of scenario files, for hypothesis."""

from copy import deepcopy
from datetime import datetime
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from made_maps import ARC, LINE, SPIRAL, road, write_map

from rt_controller.contract.signals import VehicleState
from sim_bridge.faults.fault import SHORTHANDS
from sim_bridge.scenario.metrics import Metrics

Content = dict[str, Any]
Numbers = st.SearchStrategy[Any]
MAP_FILE = "random.xodr"
_HILLS = (
    '<elevationProfile><elevation s="0" a="0" b="0.02" c="-0.0002" d="0"/></elevationProfile>'
    '<lateralProfile><superelevation s="0" a="0" b="0.0003" c="0" d="0"/></lateralProfile>'
)


def write_random_map(folder: Path) -> Path:
    """The map that random contents name, in a folder; returns the folder."""
    write_map(folder / MAP_FILE, road([(80.0, LINE), (60.0, SPIRAL), (60.0, ARC)], extra=_HILLS))
    return folder


def num(low: float, high: float) -> Numbers:
    """A number of few digits."""
    return st.floats(low, high, allow_nan=False).map(lambda x: round(x, 4))


def some(**fields: Numbers) -> Numbers:
    """A table with some of these fields."""
    return st.fixed_dictionaries({}, optional=fields)


def kind(name: str, optional: dict[str, Numbers] | None = None, **fields: Numbers) -> Numbers:
    """A table of this kind with all these fields, and with some of the optional ones."""
    return st.fixed_dictionaries({"kind": st.just(name), **fields}, optional=optional)


def one(*values: Any) -> Numbers:
    return st.sampled_from(values)


@st.composite
def knots(
    draw: st.DrawFn, axis: str, low: float, high: float, spacing: float, *kinds: str
) -> Content:
    """A table of up to six values at least `spacing` apart."""
    steps = draw(st.lists(num(spacing, 5.0 * spacing), min_size=1, max_size=6))
    x = [round(sum(steps[:k]), 4) for k in range(len(steps))]
    values = draw(st.lists(num(low, high), min_size=len(x), max_size=len(x)))
    table: Content = {axis: x, "value": values}
    if kinds and draw(st.booleans()):
        table["interpolation"] = draw(one(*kinds))
    return table


_SMOOTH = ("linear", "pchip")
_BEND = st.fixed_dictionaries(
    {"straight_m": num(1.0, 100.0), "radius_m": num(60.0, 500.0),
     "turn_deg": num(30.0, 120.0) | num(-120.0, -30.0)},
    optional={"spiral_m": num(0.0, 30.0)},
)  # fmt: skip
_FROM = {"from_per_m": num(-0.005, 0.005)}
_ENTRY = {"direction": one("left", "right"), "entry_s_m": num(0.0, 50.0), "spiral_m": num(0, 50)}
_CURVATURE = st.one_of(
    num(-0.005, 0.005),
    knots("s_m", -0.008, 0.008, 20.0, *_SMOOTH, "step", "spline"),
    kind("circle", _ENTRY, radius_m=num(60.0, 800.0)),
    kind("spiral", _FROM, start_s_m=num(0, 50), length_m=num(10, 200), to_per_m=num(-0.008, 0.008)),
    kind("step", _FROM, at_s_m=num(0.0, 50.0), to_per_m=num(-0.005, 0.005)),
    kind("course", bends=st.lists(_BEND, min_size=1, max_size=4)),
)
_FRICTION = num(0.4, 1.1) | knots("s_m", 0.4, 1.1, 5.0, *_SMOOTH, "step")
_GROUND = st.one_of(
    st.just({}),
    st.fixed_dictionaries({"friction": _FRICTION}),
    st.fixed_dictionaries({"friction_left": _FRICTION, "friction_right": _FRICTION}),
)
_WIDTH = some(width_m=num(4.0, 20.0) | knots("s_m", 6.0, 20.0, 20.0, *_SMOOTH))
_LINE = some(
    curvature_per_m=_CURVATURE,
    bank_deg=num(-6.0, 6.0) | knots("s_m", -6.0, 6.0, 30.0, *_SMOOTH),
    grade_percent=num(-8.0, 8.0) | knots("s_m", -8.0, 8.0, 30.0, *_SMOOTH),
    length_m=num(60.0, 2000.0),
) | some(roads=one(["1"], ["-1"]), flat=st.booleans()).map(
    lambda fields: {"opendrive": {"file": MAP_FILE, **fields}}
)
_WIND = num(-15.0, 15.0) | knots("t_s", -15.0, 15.0, 1.0, *_SMOOTH)
_STARTS = {"deceleration_mps2": num(1.0, 4.0), "acceleration_mps2": num(0.5, 3.0)}
_SPEED = st.one_of(
    num(0.0, 160.0),
    knots("t_s", 0.0, 110.0, 12.0, *_SMOOTH),
    knots("s_m", 5.0, 110.0, 200.0),
    kind(
        "curve_speed", {"lateral_mps2": num(0.5, 3.0), "acceleration_mps2": num(0.5, 2.0)},
        max_kmh=num(20.0, 160.0),
    ),
    kind(
        "stop_and_go", _STARTS, cruise_kmh=num(5.0, 60.0), first_stop_s_m=num(60.0, 100.0),
        spacing_m=num(20.0, 60.0), count=st.integers(1, 3), hold_s=num(0.0, 2.0),
    ),
)  # fmt: skip
_STOP = st.fixed_dictionaries({"at_s_m": num(20, 400)}, optional={"hold_s": num(0, 3), **_STARTS})


def _moves(parts: list[tuple[float, float, float]]) -> Content:
    """(gap, length, target) in a row."""
    moves, at_m = [], 0.0
    for gap_m, length_m, to_m in parts:
        moves.append({"start_m": round(at_m + gap_m, 4), "length_m": length_m - 0.01, "to_m": to_m})
        at_m += gap_m + length_m
    return {"kind": "moves", "moves": moves}


_WAVES = {"periods": num(1.0, 6.0), "fade_periods": num(0.5, 1.0)}
_CLEARANCE = {"clearance_m": num(0.0, 0.2)}
_LATERAL = st.one_of(
    num(-3.0, 3.0),
    st.lists(st.tuples(num(0.0, 50.0), num(30.0, 120.0), num(-3.0, 3.0)), max_size=4).map(_moves),
    knots("s_m", -1.0, 1.0, 60.0, "pchip", "spline"),
    knots("t_s", -1.0, 1.0, 4.0, "pchip", "spline"),
    kind(
        "sine", {"start_s_m": num(0.0, 60.0), **_WAVES},
        amplitude_m=num(-1.0, 1.0), wavelength_m=num(60, 200),
    ),
    kind(
        "sine", {"start_t_s": num(0.0, 3.0), **_WAVES},
        amplitude_m=num(-0.5, 0.5), frequency_hz=num(0.1, 0.4),
    ),
    kind(
        "slalom", _CLEARANCE,
        start_s_m=num(0, 20), spacing_m=num(30, 60), cones=st.integers(2, 6),
    ),
    *(kind(f"iso_3888_{part}", _CLEARANCE, start_s_m=num(0.0, 40.0)) for part in (1, 2)),
)  # fmt: skip


@st.composite
def _faults(draw: st.DrawFn) -> Content:
    name = draw(one(*sorted(SHORTHANDS)))
    fault = {"kind": name, "start_s": draw(num(0.0, 3.0)), "duration_s": draw(num(0.1, 2.0))}
    if name in ("state_offset", "state_noise"):
        fault |= {"signal": draw(one(*VehicleState._fields)), "value": draw(num(-0.5, 0.5))}
    if name == "state_delayed":
        fault["delay_s"] = draw(num(0.025, 0.5))
    return fault


CONTENTS = st.fixed_dictionaries(
    {
        "format": st.just(2),
        "name": st.text(min_size=1, max_size=10),
        "duration_s": num(3.0, 60.0),
        "reference": st.fixed_dictionaries({"speed_kmh": _SPEED}, optional={"ey_m": _LATERAL}),
        "road": st.tuples(_GROUND, _LINE, _WIDTH).map(lambda p: {**p[0], **p[1], **p[2]}),
    },
    optional={
        "distance_m": num(20.0, 400.0),
        "initial": some(s_m=num(0, 20), ey_m=num(-1, 1), epsi_deg=num(-3, 3), speed_kmh=num(0, 99)),
        "stops": st.lists(_STOP, max_size=2),
        "cross_wind_mps": _WIND,
        "tail_wind_mps": _WIND,
        "body": some(width_m=num(1.4, 2.2), front_m=num(1.0, 3.0), rear_m=num(1.0, 3.0)),
        "payload": st.fixed_dictionaries(
            {"mass_kg": num(0.0, 500.0)},
            optional={"ahead_m": num(-1.5, 1.0), "height_m": num(0.2, 1.2)},
        ),
        "faults": st.lists(_faults(), max_size=3),
        "metrics": st.lists(one(*Metrics._fields), max_size=4),
        "limits": st.dictionaries(one(*Metrics._fields), num(0.0, 5.0), max_size=3),
    },
)
"""content of files of format 2; most are valid, in some the parts do not fit each other"""


JUNK = one(
    None, True, "fast", "", [], {}, [1.0], [1.0, "x"], {"kind": "sine"}, {"kind": 3}, -1, 0,
    1e300, -1e300, 1e-300, float("nan"), float("inf"), 10**400, datetime(2025, 1, 1),
    {"s_m": [], "value": []}, {"s_m": [0.0], "value": ["x"]}, {"s_m": 1.0, "value": 2.0},
    {"s_m": [0.0, 1e-9], "value": [0.0, 1.0]}, {"s_m": [0.0, 1e-9], "value": [5.0, 9.0]},
    {"t_s": [0.0, 1e12], "value": [5.0, 9.0], "interpolation": "spline"},
    {"s_m": [-1e9, 1e9], "value": [0.1, 0.2], "interpolation": "pchip"},
    {"kind": "circle", "radius_m": 1e12}, {"kind": "moves", "moves": []},
    {"kind": "sine", "amplitude_m": 0.5, "wavelength_m": 1e-6},
    {"kind": "slalom", "start_s_m": 0.0, "spacing_m": 36.0, "cones": 100},
    {"kind": "iso_3888_2", "start_s_m": 1e6},
    {"kind": "stop_and_go", "cruise_kmh": 50.0, "first_stop_s_m": 1e-6, "spacing_m": 1e-6,
     "count": 50},
)  # fmt: skip


def _places(content: Any, before: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all values inside a content."""
    if not isinstance(content, dict | list):
        return [before]
    parts = content.items() if isinstance(content, dict) else enumerate(content)
    inside = [place for key, part in parts for place in _places(part, (*before, key))]
    return [before, *inside] if before else inside


@st.composite
def spoilt_contents(draw: st.DrawFn) -> Content:
    """A content with junk in some places, or with a field that does not exist."""
    content = deepcopy(draw(CONTENTS))
    for _ in range(draw(st.integers(1, 2))):
        place = draw(one(*_places(content)))
        table = content
        for part in place[:-1]:
            table = table[part]
        if draw(st.integers(0, 5)) == 0 and isinstance(table, dict):
            table["unknown"] = deepcopy(draw(JUNK))
        else:
            table[place[-1]] = deepcopy(draw(JUNK))
    return content

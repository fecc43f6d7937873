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
MAP_FILE = "random.xodr"
_HILLS = (
    '<elevationProfile><elevation s="0" a="0" b="0.02" c="-0.0002" d="0"/></elevationProfile>'
    '<lateralProfile><superelevation s="0" a="0" b="0.0003" c="0" d="0"/></lateralProfile>'
)


def write_random_map(folder: Path) -> Path:
    """The map that random contents name, in a folder; returns the folder."""
    write_map(folder / MAP_FILE, road([(80.0, LINE), (60.0, SPIRAL), (60.0, ARC)], extra=_HILLS))
    return folder


def number(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False).map(lambda x: round(x, 4))


@st.composite
def knots(
    draw: st.DrawFn, axis: str, low: float, high: float, spacing: float, kinds: list[str]
) -> Content:
    """A table of up to six values at least `spacing` apart."""
    steps = draw(st.lists(number(spacing, 5.0 * spacing), min_size=1, max_size=6))
    x = [round(sum(steps[:k]), 4) for k in range(len(steps))]
    values = draw(st.lists(number(low, high), min_size=len(x), max_size=len(x)))
    table: Content = {axis: x, "value": values}
    if kinds and draw(st.booleans()):
        table["interpolation"] = draw(st.sampled_from(kinds))
    return table


_BEND = st.fixed_dictionaries(
    {
        "straight_m": number(1.0, 100.0),
        "radius_m": number(60.0, 500.0),
        "turn_deg": number(30.0, 120.0) | number(-120.0, -30.0),
    },
    optional={"spiral_m": number(0.0, 30.0)},
)
_CURVATURE = st.one_of(
    number(-0.005, 0.005),
    knots("s_m", -0.008, 0.008, 20.0, ["linear", "step", "pchip", "spline"]),
    st.fixed_dictionaries(
        {"kind": st.just("circle"), "radius_m": number(60.0, 800.0)},
        optional={
            "direction": st.sampled_from(["left", "right"]),
            "entry_s_m": number(0.0, 50.0),
            "spiral_m": number(0.0, 50.0),
        },
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("spiral"),
            "start_s_m": number(0.0, 50.0),
            "length_m": number(10.0, 200.0),
            "to_per_m": number(-0.008, 0.008),
        },
        optional={"from_per_m": number(-0.008, 0.008)},
    ),
    st.fixed_dictionaries(
        {"kind": st.just("step"), "at_s_m": number(0.0, 50.0), "to_per_m": number(-0.005, 0.005)},
        optional={"from_per_m": number(-0.005, 0.005)},
    ),
    st.fixed_dictionaries(
        {"kind": st.just("course"), "bends": st.lists(_BEND, min_size=1, max_size=4)}
    ),
)
_FRICTION = number(0.4, 1.1) | knots("s_m", 0.4, 1.1, 5.0, ["linear", "step", "pchip"])
_GROUND = st.one_of(
    st.just({}),
    st.fixed_dictionaries({"friction": _FRICTION}),
    st.fixed_dictionaries({"friction_left": _FRICTION, "friction_right": _FRICTION}),
)
_KINDS = ["linear", "pchip"]
_WIDTH = st.fixed_dictionaries(
    {}, optional={"width_m": number(4.0, 20.0) | knots("s_m", 6.0, 20.0, 20.0, _KINDS)}
)
_LINE = st.fixed_dictionaries(
    {},
    optional={
        "curvature_per_m": _CURVATURE,
        "bank_deg": number(-6.0, 6.0) | knots("s_m", -6.0, 6.0, 30.0, _KINDS),
        "grade_percent": number(-8.0, 8.0) | knots("s_m", -8.0, 8.0, 30.0, _KINDS),
        "length_m": number(60.0, 2000.0),
    },
) | st.fixed_dictionaries(
    {
        "opendrive": st.fixed_dictionaries(
            {"file": st.just(MAP_FILE)},
            optional={"roads": st.sampled_from([["1"], ["-1"]]), "flat": st.booleans()},
        )
    }
)
_WIND = number(-15.0, 15.0) | knots("t_s", -15.0, 15.0, 1.0, _KINDS)
_SPEED = st.one_of(
    number(0.0, 160.0),
    knots("t_s", 0.0, 110.0, 12.0, ["linear", "pchip"]),
    knots("s_m", 5.0, 110.0, 200.0, []),
    st.fixed_dictionaries(
        {"kind": st.just("curve_speed"), "max_kmh": number(20.0, 160.0)},
        optional={"lateral_mps2": number(0.5, 3.0), "acceleration_mps2": number(0.5, 2.0)},
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("stop_and_go"),
            "cruise_kmh": number(5.0, 60.0),
            "first_stop_s_m": number(60.0, 100.0),
            "spacing_m": number(20.0, 60.0),
            "count": st.integers(1, 3),
            "hold_s": number(0.0, 2.0),
        },
        optional={"deceleration_mps2": number(1.0, 4.0), "acceleration_mps2": number(0.5, 3.0)},
    ),
)
_STOP = st.fixed_dictionaries(
    {"at_s_m": number(20.0, 400.0)},
    optional={
        "hold_s": number(0.0, 3.0),
        "deceleration_mps2": number(1.0, 6.0),
        "acceleration_mps2": number(0.5, 3.0),
    },
)
_MOVES = st.lists(
    st.tuples(number(0.0, 50.0), number(30.0, 120.0), number(-3.0, 3.0)), max_size=4
).map(
    lambda parts: {
        "kind": "moves",
        "moves": [
            {
                "start_m": round(sum(gap + length for gap, length, _ in parts[:k]) + gap, 4),
                "length_m": length - 0.01,
                "to_m": to,
            }
            for k, (gap, length, to) in enumerate(parts)
        ],
    }
)
_WAVES = {"periods": number(1.0, 6.0), "fade_periods": number(0.5, 1.0)}
_CLEARANCE = {"clearance_m": number(0.0, 0.2)}
_LATERAL = st.one_of(
    number(-3.0, 3.0),
    _MOVES,
    knots("s_m", -1.0, 1.0, 60.0, ["pchip", "spline"]),
    st.fixed_dictionaries(
        {
            "kind": st.just("sine"),
            "amplitude_m": number(-1.0, 1.0),
            "wavelength_m": number(60, 200),
        },
        optional={"start_s_m": number(0.0, 60.0), **_WAVES},
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("sine"),
            "amplitude_m": number(-0.5, 0.5),
            "frequency_hz": number(0.1, 0.4),
        },
        optional={"start_t_s": number(0.0, 3.0), **_WAVES},
    ),
    knots("t_s", -1.0, 1.0, 4.0, ["pchip", "spline"]),
    st.fixed_dictionaries(
        {
            "kind": st.just("slalom"),
            "start_s_m": number(0.0, 20.0),
            "spacing_m": number(30.0, 60.0),
            "cones": st.integers(2, 6),
        },
        optional=_CLEARANCE,
    ),
    st.fixed_dictionaries(
        {"kind": st.sampled_from(["iso_3888_1", "iso_3888_2"]), "start_s_m": number(0.0, 40.0)},
        optional=_CLEARANCE,
    ),
)
_INITIAL = st.fixed_dictionaries(
    {},
    optional={
        "s_m": number(0.0, 20.0),
        "ey_m": number(-0.5, 0.5),
        "epsi_deg": number(-3.0, 3.0),
        "speed_kmh": number(0.0, 100.0),
    },
)


@st.composite
def _faults(draw: st.DrawFn) -> Content:
    kind = draw(st.sampled_from(sorted(SHORTHANDS)))
    fault: Content = {
        "kind": kind,
        "start_s": draw(number(0.0, 3.0)),
        "duration_s": draw(number(0.1, 2.0)),
    }
    if kind in ("state_offset", "state_noise"):
        fault["signal"] = draw(st.sampled_from(VehicleState._fields))
        fault["value"] = draw(number(-0.5, 0.5))
    if kind == "state_delayed":
        fault["delay_s"] = draw(number(0.025, 0.5))
    return fault


CONTENTS = st.fixed_dictionaries(
    {
        "format": st.just(2),
        "name": st.text(min_size=1, max_size=10),
        "duration_s": number(3.0, 60.0),
        "reference": st.fixed_dictionaries({"speed_kmh": _SPEED}, optional={"ey_m": _LATERAL}),
        "road": st.tuples(_GROUND, _LINE, _WIDTH).map(
            lambda parts: {**parts[0], **parts[1], **parts[2]}
        ),
    },
    optional={
        "distance_m": number(20.0, 400.0),
        "initial": _INITIAL,
        "stops": st.lists(_STOP, max_size=2),
        "cross_wind_mps": _WIND,
        "tail_wind_mps": _WIND,
        "body": st.fixed_dictionaries(
            {},
            optional={
                "width_m": number(1.4, 2.2),
                "front_m": number(1.0, 3.0),
                "rear_m": number(1.0, 3.0),
            },
        ),
        "payload": st.fixed_dictionaries(
            {"mass_kg": number(0.0, 500.0)},
            optional={"ahead_m": number(-1.5, 1.0), "height_m": number(0.2, 1.2)},
        ),
        "faults": st.lists(_faults(), max_size=3),
        "metrics": st.lists(st.sampled_from(Metrics._fields), max_size=4),
        "limits": st.dictionaries(st.sampled_from(Metrics._fields), number(0.0, 5.0), max_size=3),
    },
)
"""content of files of format 2; most are valid, in some the parts do not fit each other"""


JUNK = st.sampled_from(
    [
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
    ]
)  # fmt: skip


def _places(content: Any, before: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all values inside a content."""
    if isinstance(content, dict):
        parts = content.items()
    elif isinstance(content, list):
        parts = enumerate(content)
    else:
        return [before]
    return [*([before] if before else []),
            *(place for key, part in parts for place in _places(part, (*before, key)))]  # fmt: skip


@st.composite
def spoilt_contents(draw: st.DrawFn) -> Content:
    """A content with junk in some places, or with a field that does not exist."""
    content = deepcopy(draw(CONTENTS))
    for _ in range(draw(st.integers(1, 2))):
        place = draw(st.sampled_from(_places(content)))
        table = content
        for part in place[:-1]:
            table = table[part]
        if draw(st.integers(0, 5)) == 0 and isinstance(table, dict):
            table["unknown"] = deepcopy(draw(JUNK))
        else:
            table[place[-1]] = deepcopy(draw(JUNK))
    return content

"""Drives outside the tables: those that the bicycle is fitted to, and those of the search."""

from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from sim_bridge.faults.sensors import sensor_noise
from sim_bridge.scenario import Scenario

METRICS = ("ey_rms_m", "speed_rms_mps")
_NOISE_SEED = 11


def _scenario(
    name: str, duration_s: float, speed_kmh: Any, ey_m: Any = 0.0, **others: Any
) -> Scenario:
    reference = {"speed_kmh": speed_kmh, "ey_m": ey_m}
    fields = {"format": 2, "name": name, "duration_s": duration_s, "metrics": METRICS, **others}
    return TypeAdapter(Scenario).validate_python({**fields, "reference": reference})


def _move(length_m: float) -> dict[str, Any]:
    return {"kind": "moves", "moves": ({"start_m": 12.0, "length_m": length_m, "to_m": 3.5},)}


def _sine(amplitude_m: float, frequency_hz: float) -> dict[str, Any]:
    sine = {"amplitude_m": amplitude_m, "frequency_hz": frequency_hz, "start_t_s": 0.5}
    return {"kind": "sine", **sine}


def _circle(
    radius_m: float, direction: str, entry_s_m: float = 20.0, spiral_m: float = 40.0
) -> dict[str, Any]:
    per_m = (1.0 if direction == "left" else -1.0) / radius_m
    knots = {"s_m": (entry_s_m, entry_s_m + spiral_m), "value": (0.0, per_m)}
    return {"curvature_per_m": knots}


def _over_time(*knots: tuple[float, float]) -> dict[str, Any]:
    t_s, value = zip(*knots, strict=True)
    return {"t_s": t_s, "value": value}


FIT = (
    _scenario(
        "fit: sine, 40 to 120 km/h and back",
        18.0,
        _over_time((0.0, 45.0), (10.0, 120.0), (18.0, 60.0)),
        _sine(0.35, 0.45),
    ),
    _scenario("fit: sine of 1.6 m at 0.3 Hz, 75 km/h", 18.0, 75.0, _sine(1.6, 0.3)),
    _scenario(
        "fit: moves of 3.5 m over 36 m, 75 km/h",
        18.0,
        75.0,
        {
            "kind": "moves",
            "moves": tuple(
                {"start_m": 12.0 + 60.0 * k, "length_m": 36.0, "to_m": 3.5 * (1 - k % 2)}
                for k in range(6)
            ),
        },
    ),
    _scenario(
        "fit: bend of 120 m, 40 to 70 km/h and back",
        18.0,
        _over_time((0.0, 45.0), (5.0, 45.0), (9.0, 75.0), (12.0, 75.0), (16.0, 40.0), (18.0, 50.0)),
        road=_circle(120.0, "right"),
    ),
)
_STRAIGHT = _scenario("noise, straight, 80 km/h", 3.0, 80.0)
NOISY = replace(_STRAIGHT, faults=tuple(sensor_noise(np.random.default_rng(_NOISE_SEED))))
"""in which the rate of the steering wheel counts too"""
SEARCH = (
    NOISY,
    _scenario("move to the left, 70 km/h", 4.0, 70.0, _move(42.0)),
    _scenario("move to the left, 100 km/h", 3.8, 100.0, _move(62.0)),
    _scenario(
        "slalom of 30 m, 50 km/h",
        5.5,
        50.0,
        {"kind": "slalom", "start_s_m": 10.0, "spacing_m": 30.0, "cones": 3},
    ),
    _scenario("bend of 150 m, 70 km/h", 5.0, 70.0, road=_circle(150.0, "left")),
    *(
        _scenario(
            f"bend of {radius_m:g} m to the {side}, {kmh:g} km/h",
            6.0,
            kmh,
            road=_circle(radius_m, side, 15.0, 25.0),
        )
        for radius_m, kmh, side in ((50.0, 48.0, "left"), (28.0, 36.0, "right"))
    ),
    _scenario("sine, 90 km/h", 4.0, 90.0, _sine(0.5, 0.5)),
    _scenario(
        "side wind of 10 m/s, 90 km/h",
        5.0,
        90.0,
        cross_wind_mps={"t_s": [0.5, 1.0], "value": [0.0, 10.0]},
    ),
    _scenario(
        "move to the left, 75 km/h, friction 0.7, 200 kg",
        4.0,
        75.0,
        _move(46.0),
        road={"friction": 0.7},
        payload={"mass_kg": 200.0},
    ),
)

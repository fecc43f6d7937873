"""A drive as text: an npz file in base64, its arrays and the rest as JSON. No pickle."""

import base64
import json
from io import BytesIO
from typing import Any
from zipfile import BadZipFile

import numpy as np

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput
from rt_controller.drive.scenario import (
    CarFigure,
    ConeAt,
    DrivenScenario,
    LaneAt,
    LateralError,
    Outline,
    RoadLine,
)
from rt_controller.drive.table import COLUMNS, Drive, TrackingErrors

FORMAT = 1
_COLUMN_NAMES = tuple(signal.name for signal in COLUMNS)
_TEXTS = ("model", "ending", "stop_cause", "stop_tick", "stop_s")
"""fields that JSON can hold as they are"""


def pack_drive(drive: Drive) -> str:
    """The drive without its predicted horizons."""
    arrays = {"values": drive.values}
    if drive.true_poses is not None:
        arrays["true_poses"] = drive.true_poses
    rest: dict[str, Any] = {name: getattr(drive, name) for name in _TEXTS}
    rest |= {
        "format": FORMAT,
        "columns": _COLUMN_NAMES,
        "errors": drive.errors,
        "car_error": drive.car_error,
    }
    rest |= {"car_figures": drive.car_figures, "at_limit_s": drive.at_limit_s}
    if drive.scenario is not None:
        road = drive.scenario.road
        rest["scenario"] = {**drive.scenario._asdict(), "road": None}
        arrays |= {} if road is None else {f"road_{k}": v for k, v in road._asdict().items()}
    out = BytesIO()
    text = np.frombuffer(json.dumps(rest).encode(), dtype=np.uint8)
    np.savez_compressed(out, rest=text, allow_pickle=False, **arrays)
    return base64.b64encode(out.getvalue()).decode()


def unpack_drive(text: str, source: str) -> Drive:
    """The drive of `pack_drive`; `source` is named in errors.

    Raises:
        ConfigError: the data are not that, or of another version.
    """
    try:
        with np.load(BytesIO(base64.b64decode(text)), allow_pickle=False) as arrays:
            rest = json.loads(arrays["rest"].tobytes())
            if rest["format"] != FORMAT or tuple(rest["columns"]) != _COLUMN_NAMES:
                raise ValueError("of another version")
            road = [arrays[f"road_{name}"] for name in RoadLine._fields if f"road_{name}" in arrays]
            scenario = rest.get("scenario")
            return Drive(
                values=arrays["values"],
                true_poses=arrays.get("true_poses"),
                errors=TrackingErrors(*rest["errors"]),
                car_error=None if rest["car_error"] is None else LateralError(*rest["car_error"]),
                car_figures=tuple(CarFigure(*each) for each in rest["car_figures"]),
                at_limit_s=ControlInput(*rest["at_limit_s"]),
                scenario=None if scenario is None else _scenario(scenario, road),
                **{name: rest[name] for name in _TEXTS},
            )
    except (BadZipFile, ValueError, KeyError, TypeError, EOFError, OSError) as error:
        raise ConfigError(
            f"{source}: expected drives that this version packed, found other data "
            f"({error}). Delete it and drive again, or use the version that wrote it."
        ) from error


def _scenario(rest: dict[str, Any], road: list[Any]) -> DrivenScenario:
    parts = {
        "cones": tuple(ConeAt(*each) for each in rest["cones"]),
        "lanes": tuple(LaneAt(*each) for each in rest["lanes"]),
        "road": RoadLine(*road) if road else None,
        "body": Outline(*rest["body"]),
    }
    return DrivenScenario(**{**rest, **parts})

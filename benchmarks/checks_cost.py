"""`python -m benchmarks.checks_cost`: CPU time of all plausibility checks of one tick, by stage."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import cyclopts
import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.tables import percentiles
from rt_controller.contract.figures import write_figures
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.signals import (
    NEUTRAL_INPUT,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.safety.actuators import CommandRange
from rt_controller.safety.finding import Windows
from rt_controller.safety.inputs import ReceivedInputs
from rt_controller.safety.path.last_road import LastRoad
from rt_controller.safety.path.path_checks import PathChecks
from rt_controller.safety.prediction import MotionPrediction
from rt_controller.safety.residuals import Residuals
from rt_controller.safety.supervisor import Supervisor

TICKS = 4000
DROPPED = 200
"""ticks before the caches are warm"""
STAGES: tuple[tuple[str, type, tuple[str, ...]], ...] = (
    ("ten roll-outs of the model", MotionPrediction, ("advance", "newest", "oldest", "begin")),
    ("states against each other", Residuals, ("advance", "compare", "follow")),
    ("curvature ahead", LastRoad, ("move", "compare", "take", "curvature_here", "ahead")),
    ("path", PathChecks, ("move", "compare", "accept")),
    ("actuators", CommandRange, ("add", "distance")),
    ("thresholds and windows", Windows, ("failing",)),
)
"""name, class, methods"""


app = cyclopts.App(name="python -m benchmarks.checks_cost", version_flags=[])


@app.default
def main(
    model: str | None = None,
    *,
    json: Annotated[Path | None, cyclopts.Parameter(name="--json")] = None,
) -> None:
    """CPU time of `judge` and `note`, back to back, with the ten roll-outs of a model.

    The stages are measured in a second run, whose clock reads cost time of their own.

    Args:
        model: name of a shipped model, or folder of a bundle.
        json: also write the figures there.
    """
    bundle = Bundle.load(model)
    with threadpool_limits(1, "blas"):
        figures = {"all": _percentiles(drive(bundle))}
        print(_line("all checks of a tick", figures["all"]))
        took_us = {name: np.zeros(TICKS) for name, _, _ in STAGES}
        _drive_in_stages(bundle, took_us)
    for name, values in took_us.items():
        figures[name] = _percentiles(values)
        print(_line(name, figures[name]))
    write_figures(json, figures)


def drive(
    bundle: Bundle, begin_tick: Callable[[int], None] = lambda tick: None
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(TICKS,) CPU time in us of the checks of a car on a straight road."""
    supervisor = Supervisor(MotionPrediction(bundle, bundle.n_observables))
    psi = np.zeros(bundle.n_observables)
    took_us = np.zeros(TICKS)
    for tick in range(TICKS):
        begin_tick(tick)
        vx_mps = 20.0 + 0.005 * (tick % 2)
        state = VehicleState(vx_mps, 0.0, 0.0, 0.5, 0.0, 0.0)
        psi[: len(state)] = state
        received = ReceivedInputs(
            state=state,
            curvature_per_m=0.0,
            path=PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0),
            preview=CurvaturePreview(3.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            applied=NEUTRAL_INPUT,
            feedback=NEUTRAL_INPUT,
            is_driven=tick > 0,
            is_stopping=False,
            periods=1,
        )
        begun_ns = time.thread_time_ns()
        supervisor.judge(received)
        supervisor.note(NEUTRAL_INPUT, psi)
        took_us[tick] = (time.thread_time_ns() - begun_ns) * 1e-3
    return took_us


def _drive_in_stages(
    bundle: Bundle, took_us: dict[str, np.ndarray[Any, np.dtype[np.float64]]]
) -> None:
    present = 0

    def begin_tick(tick: int) -> None:
        nonlocal present
        present = tick

    def timed(values: np.ndarray[Any, Any], method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            begun_ns = time.thread_time_ns()
            result = method(*arguments)
            values[present] += (time.thread_time_ns() - begun_ns) * 1e-3
            return result

        return call

    kept = [(each, name, getattr(each, name)) for _, each, names in STAGES for name in names]
    for stage, each, names in STAGES:
        for name in names:
            setattr(each, name, timed(took_us[stage], getattr(each, name)))
    try:
        drive(bundle, begin_tick)
    finally:
        for each, name, method in kept:
            setattr(each, name, method)


def _percentiles(took_us: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float]:
    return percentiles(took_us[DROPPED:])


def _line(name: str, figures: dict[str, float]) -> str:
    p50, p99, most = (figures[key] for key in ("p50_us", "p99_us", "max_us"))
    return f"{name}: p50 {p50:.1f}, p99 {p99:.1f}, max {most:.0f} us of CPU time"


if __name__ == "__main__":
    app()

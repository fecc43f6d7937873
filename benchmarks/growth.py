"""`python -m benchmarks.growth`: time of a solve against horizon and latents."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NamedTuple

import cyclopts
import numpy as np
from rich.console import Console

from benchmarks.staged import StagedPiqp, StagedQp
from benchmarks.tables import percentiles, timed
from rt_controller.config import ControllerConfig
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.model.artifact import load_bundle, shipped_model
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.signals import VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.program import QpParameters
from rt_controller.control.qp import CondensedQp
from rt_controller.control.solver import Solver, SolveStatus, open_solver
from rt_controller.report.table import Column, Table, print_table
from rt_controller.terminal.command_line import run_command

HORIZONS = (10, 20, 40, 80, 160)
LATENTS = (0, 8, 20, 60, 120, 240)
SPEED_MPS = 22.0


def with_latents(linear: Bundle, latents: int) -> Bundle:
    """The linear model with stable random latents, coupled to its states in both directions."""
    rng = np.random.default_rng(latents)
    n = linear.n_observables
    A = np.zeros((n + latents, n + latents))
    A[:n, :n] = linear.A
    if latents:
        dynamics = rng.normal(size=(latents, latents))
        A[n:, n:] = 0.9 / np.abs(np.linalg.eigvals(dynamics)).max() * dynamics
        A[:n, n:] = 1e-3 * rng.normal(size=(n, latents))
        A[n:, :n] = 1e-2 * rng.normal(size=(latents, n))
    B_of_latents = rng.normal(size=(latents, linear.B_uc.shape[1]))
    psi_of_latents = rng.normal(size=(len(linear.selftest_psi), latents))
    return replace(
        linear,
        A=A,
        B_uc=np.vstack([linear.B_uc, 1e-2 * B_of_latents]),
        B_uw=np.vstack([linear.B_uw, np.zeros((latents, 1))]),
        c=np.concatenate([linear.c, np.zeros(latents)]),
        selftest_psi=np.hstack([linear.selftest_psi, psi_of_latents]),
    )


def set_slalom(parameters: QpParameters, tick: int) -> None:
    """Write the parameters of a car that swings about its path, slower than its reference."""
    phase = 0.15 * tick
    ds_m = PERIOD_S * SPEED_MPS
    state = VehicleState(
        vx_mps=SPEED_MPS,
        vy_mps=0.05 * np.sin(phase),
        yaw_rate_radps=0.05 * np.cos(phase),
        ds_m=ds_m,
        ey_m=0.3 * np.sin(phase),
        epsi_rad=0.03 * np.cos(phase),
    )
    parameters.psi[:] = 0.0
    parameters.psi[: len(state)] = state
    parameters.previous[:] = (0.1, 0.0, 0.2 * np.sin(phase))
    parameters.reference[:] = VehicleState(SPEED_MPS + 0.5, 0.0, 0.0, ds_m, 0.0, 0.0)


MAX_STAGED_ENTRIES = 400_000
"""of the matrix with states; a larger one takes much longer than a period"""
CONDENSED, WARM = "condensed, PIQP", "condensed, PIQP, warm"
DAQP, STAGED = "condensed, DAQP", "staged, PIQP"


class Size(NamedTuple):
    """Times for one horizon and one number of latents, by form and solver."""

    horizon: int
    latents: int
    p50_us: dict[str, float]
    p99_us: dict[str, float]
    unsolved: dict[str, int]


def measure(bundle: Bundle, latents: int, horizon: int, ticks: int) -> Size:
    """Times of every form and solver on the same problems."""
    cost = ControllerConfig().mpc.cost()
    condensed = CondensedQp(bundle, horizon, cost)
    program = condensed.program
    forms: dict[str, tuple[CondensedQp | StagedQp, Callable[[], Solver]]] = {
        CONDENSED: (condensed, lambda: open_solver(program, warm_start=False)),
        WARM: (condensed, lambda: open_solver(program)),
        DAQP: (condensed, lambda: open_solver(program, "daqp")),
    }
    if horizon * bundle.n_observables**2 <= MAX_STAGED_ENTRIES:
        staged = StagedQp(bundle, horizon, cost)
        forms[STAGED] = (staged, lambda: StagedPiqp(staged))
    size = Size(horizon, latents, {}, {}, {})
    for name, (qp, open_form) in forms.items():
        times_us, size.unsolved[name] = _time(qp, open_form(), ticks)
        found = percentiles(times_us)
        size.p50_us[name], size.p99_us[name] = found["p50_us"], found["p99_us"]
    return size


def _time(qp: CondensedQp | StagedQp, solver: Solver, ticks: int) -> tuple[list[float], int]:
    pedals, unsolved = PedalChoice(), 0
    times_us: list[float] = []
    for tick in range(ticks):
        set_slalom(qp.parameters, tick)
        qp.update_vectors(pedals)
        status, took_us = timed(solver.solve)
        times_us.append(took_us)
        unsolved += status is not SolveStatus.SOLVED
    return times_us, unsolved


app = cyclopts.App(name="python -m benchmarks.growth", version_flags=[])


@app.default
def main(
    *,
    horizons: tuple[int, ...] = HORIZONS,
    latents: tuple[int, ...] = LATENTS,
    ticks: int = 60,
    json: Annotated[Path | None, cyclopts.Parameter(name="--json")] = None,
) -> int:
    """The time of one solve, with the states eliminated (condensed) or as variables (staged).

    Parameters
    ----------
    horizons
        Numbers of stages.
    latents
        Numbers of observables besides the six states.
    ticks
        Problems solved for each size.
    json
        File for all figures.
    """
    require_writable(json)
    console = Console()
    linear = load_bundle(shipped_model("lti"))
    sizes = []
    for count in latents:
        bundle = with_latents(linear, count)
        for horizon in horizons:
            with console.status(f"{horizon} stages, {count} latents"):
                sizes.append(measure(bundle, count, horizon, ticks))
    print_table(_table(sizes), console)
    write_figures(json, {"ticks": ticks, "sizes": [size._asdict() for size in sizes]})
    return 0


def _table(sizes: Sequence[Size]) -> Table:
    names = (CONDENSED, WARM, DAQP, STAGED)
    heads = [Column(form, solver) for form, _, solver in (name.partition(", ") for name in names)]
    rows = []
    for size in sizes:
        times = (
            f"{size.p50_us[name]:.0f}/{size.p99_us[name]:.0f}" if name in size.p50_us else ""
            for name in names
        )
        rows.append((str(size.horizon), str(size.latents), *times))
    columns = (Column("stages"), Column("latents"), *heads)
    return Table("median / p99 of a solve in us", columns, tuple(rows))


if __name__ == "__main__":
    run_command(app)

"""`python -m benchmarks.tuning`: weights or gains of any controller, by one search and one cost.

The drives are those of `benchmarks.rivals.scenarios`, outside the tables of the documents. The cost
is the sum over the drives of the RMS of the lateral error in m and a tenth of that of the speed
error in m/s, of the car itself, and 0.01 for each deg/s of the steering wheel above 10 on a
straight road with noisy sensors. A safe stop costs 1.
"""

from collections.abc import Callable
from functools import partial
from math import inf, isfinite
from typing import Annotated, Any

import cyclopts
import optuna
from rich.console import Console

from benchmarks.rivals.scenarios import NOISY, SEARCH
from offline.commands.options import JsonFile
from rt_controller import ControllerConfig, Drive, simulate
from rt_controller.baselines.bicycle_mpc import BicycleMpc, settings_of
from rt_controller.baselines.stanley import Gains, Stanley
from rt_controller.baselines.tuned import tuned_values
from rt_controller.contract.errors import ConfigError, ControlLawError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.controllers import BASELINES
from rt_controller.drive.comfort import wheel_rate_rms_degps
from rt_controller.terminal.command_line import run_command
from sim_bridge.scenario import Scenario

STANLEY = "stanley"
WORST = 10.0
"""cost of a drive whose errors are not finite"""
NEARBY = 1.5
_WEIGHTS = {
    "ey_m": (0.03, 0.6),
    "epsi_deg": (0.5, 8.0),
    "vx_mps": (0.2, 3.0),
    "steer_change_deg": (2.0, 40.0),
    "throttle_change": (0.05, 1.0),
    "brake_change_n": (10.0, 150.0),
    "terminal_factor": (1.0, 50.0),
    "disturbance_gain": (0.005, 0.3),
}
_GAINS = {
    "lateral_per_s": (0.3, 12.0),
    "softening_mps": (0.1, 20.0),
    "heading": (0.2, 3.0),
    "yaw_damping_s": (0.002, 0.4),
    "understeer_rad_per_mps2": (0.0005, 0.01),
    "sideslip_s2_per_m": (0.0005, 0.02),
    "preview_s": (0.01, 0.28),
    "integral_per_s": (0.01, 2.0),
    "speed_per_s": (0.2, 20.0),
    "speed_integral_per_s2": (0.01, 2.0),
}
"""ranges of the search, logarithmic"""

app = cyclopts.App(name="python -m benchmarks.tuning", version_flags=[])


def cost_of(drive: Drive, scenario: Scenario) -> float:
    """Cost of one drive; see the module."""
    found = {figure.name: figure.value for figure in drive.car_figures}
    cost = found["ey_rms_m"] + 0.1 * found["speed_rms_mps"]
    if scenario is NOISY:
        cost += 0.01 * max(wheel_rate_rms_degps(drive) - 10.0, 0.0)
    cost += 0.0 if drive.stop_s is None else 1.0
    return cost if isfinite(cost) else WORST


def _driver(controller: str, values: dict[str, float]) -> Callable[[Scenario], Drive]:
    if controller == STANLEY:
        return partial(simulate, controller=Stanley(Gains(**values)))
    if controller in BASELINES:
        return partial(simulate, controller=BicycleMpc(values))
    return partial(simulate, model=controller, config=ControllerConfig(mpc=settings_of(values)))


@app.default
def main(
    *,
    controller: str,
    trials: Annotated[int, cyclopts.Parameter(validator=cyclopts.validators.Number(gte=1))] = 60,
    seed: int = 0,
    nearby: Annotated[bool, cyclopts.Parameter(negative="")] = False,
    json: JsonFile = None,
) -> int:
    """Search the weights or gains of a controller; the first trial is that of its defaults.

    The second one of a rival is the result of its last search.

    Args:
        controller: stanley, bicycle-mpc, a shipped model, or the folder of a bundle.
        trials: number of trials, each a drive of every scenario of the search.
        seed: of the search (TPE of Optuna).
        nearby: search within a factor of 1.5 of the last result of a rival.
    """
    require_writable(json)
    space = _GAINS if controller == STANLEY else _WEIGHTS
    if nearby and controller not in BASELINES:
        raise ConfigError(
            f"--nearby: expected a rival with an earlier result ({', '.join(BASELINES)}), found "
            f"{controller}. Leave --nearby out."
        )
    begin = tuned_values(controller) if controller in BASELINES else {}
    if nearby:
        space = {k: (v / NEARBY, v * NEARBY) for k, v in begin.items()}
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    console = Console(stderr=True)

    def run(trial: Any) -> float:
        values = {name: trial.suggest_float(name, *ends, log=True) for name, ends in space.items()}
        drive, total, best = _driver(controller, values), 0.0, inf
        if trial.number:
            best = study.best_value
        for step, scenario in enumerate(SEARCH):
            try:
                cost = cost_of(drive(scenario), scenario)
            except ControlLawError:
                cost = WORST
            total += cost
            trial.set_user_attr(scenario.name, cost)
            trial.report(total, step)
            if total > best:  # costs are positive: this trial cannot be the best one
                raise optuna.TrialPruned
        console.print(f"trial {trial.number}: {total:.4f}", highlight=False)
        return total

    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed, multivariate=True))
    settings = settings_of({})
    known = {**settings.model_dump(), **settings.tolerance.model_dump(), **Gains()._asdict()}
    if not nearby:
        study.enqueue_trial({name: known[name] for name in space})
    if controller in BASELINES:
        study.enqueue_trial(begin)
    study.optimize(run, n_trials=trials)
    best = study.best_trial
    options = f"--controller {controller} --trials {trials} --seed {seed}{' --nearby' * nearby}"
    figures = {
        "command": f"python -m benchmarks.tuning {options}",
        "began_at": begin,
        "cost": best.value,
        f"cost_of_{'last' if nearby else 'defaults'}": study.trials[0].value,
        "costs": best.user_attrs,
        "values": {name: float(f"{value:.4g}") for name, value in best.params.items()},
    }
    write_figures(json, figures)
    console.print(figures)
    return 0


if __name__ == "__main__":
    run_command(app)

"""`CarEnv`: the simulated car in a scenario as a Gymnasium environment, without a bus.

Importing this module registers it as `sim_bridge/Track-v0`.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from math import atan, pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.car import DEFAULT_CAR as LIMITS_OF
from rt_controller.contract.errors import ConfigError, needs_extra
from rt_controller.contract.limits import INPUT_LIMITS, LEAST_FRICTION, MOST_FRICTION
from rt_controller.contract.preview import KNOTS, LONGEST_SPACING_M
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.envelope import limit
from sim_bridge.adapters.own_car import OwnCar, ground_at
from sim_bridge.bridge import DEFAULT_DELAY
from sim_bridge.car import FASTEST_MPS
from sim_bridge.plant.parameters import load_parameters, with_mass_factor, with_payload, with_road
from sim_bridge.plant.parts import Payload
from sim_bridge.plant.shipped_cars import DEFAULT_CAR
from sim_bridge.scenario import Scenario, load_scenario
from sim_bridge.scenario_run import ScenarioRun
from sim_bridge.session import build_car

with needs_extra("gym", "The Gymnasium environment"):
    import gymnasium
    from gymnasium.spaces import Box

ENV_ID = "sim_bridge/Track-v0"
CHANGE_WEIGHT = 0.02
"""share of the reward that the fastest change of an input takes"""
LARGEST_START_EY_M = 1.0
MASS_FACTORS = (0.5, 2.0)
_FASTEST_CHANGE = PERIOD_S * np.array(INPUT_LIMITS.rate_per_s)

Floats = NDArray[np.float32]
Range = float | Sequence[float]
"""a value, or the limits of a uniform distribution"""


class Errors(NamedTuple):
    """The car against the wanted path and speed."""

    ey_error_m: float
    epsi_error_rad: float
    speed_error_mps: float


LARGEST = Errors(1.75, pi / 4, 10.0)
"""beyond which an episode is terminated"""
SCALE = Errors(1.0, 0.5, 5.0)
"""each of which alone takes the whole reward of a step"""


class ObservedValues(NamedTuple):
    """What an agent sees; the fields are the order of the array.

    Curvatures are those of the wanted path, 0 to 4 spacings ahead of the car along the road,
    positive to the left. The spacing is a quarter of the way in 1.1 s.
    """

    vx_mps: float
    vy_mps: float
    yaw_rate_radps: float
    ey_error_m: float
    """place against the wanted path, positive to its left"""
    epsi_error_rad: float
    """heading against the wanted path"""
    wanted_mps: float
    wanted_mps2: float
    spacing_m: float
    k0_per_m: float
    k1_per_m: float
    k2_per_m: float
    k3_per_m: float
    k4_per_m: float
    throttle: float
    """of the newest command, as limited"""
    brake_n: float
    steer_rad: float
    throttle_before: float
    """of the command a period before; later ones do not act yet"""
    brake_before_n: float
    steer_before_rad: float


_INPUTS = (1.0, INPUT_LIMITS.upper.brake_n, LIMITS_OF.geometry.lock_rad)
_HIGHEST = np.array(
    [
        *(FASTEST_MPS, 50.0, 10.0, 10.0, pi, FASTEST_MPS, 50.0, LONGEST_SPACING_M),
        *KNOTS * [1.0],
        *(_INPUTS + _INPUTS),
    ],
    dtype=np.float32,
)
"""ends of the ranges, which begin at the same below 0; what is beyond them is clipped"""


class CarEnv(gymnasium.Env[Floats, Floats]):
    """The car drives a scenario; a step is a control period of 25 ms.

    The action is (pedals, steering wheel), each from -1 to 1. Pedals above 0 are the throttle,
    below 0 the brake, 1 is full. The wheel is a share of the largest angle at this speed, that of
    a lateral acceleration of 7 m/s^2 and at least 40 deg, positive to the left. Rates are limited
    as the controller limits its own commands, and a command acts as late as over the bus: two
    periods after the observation that it answers.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": round(1.0 / PERIOD_S)}  # noqa: RUF012

    def __init__(
        self,
        scenario: str | Path | Scenario | Sequence[str | Path | Scenario] = "double_lane_change",
        *,
        car: str | Path = DEFAULT_CAR,
        friction: Range | None = None,
        mass_factor: Range = 1.0,
        start_ey_m: float = 0.0,
    ) -> None:
        """Read scenarios and car. What is a range, or a list, is drawn in each episode.

        Args:
            scenario: a shipped name, the path of a file, or a `Scenario`; or a list of them.
            car: a shipped name, or the path of a .toml file.
            friction: of the road, on both sides; None: the scenario's.
            mass_factor: of masses and inertias of the body.
            start_ey_m: the car starts up to so far beside the start of the scenario.

        Raises:
            ConfigError: scenario, car or a value is refused.
            MissingExtraError: the car is not compiled.
        """
        listed = [scenario] if isinstance(scenario, str | Path | Scenario) else scenario
        if not listed:
            raise ConfigError("scenario: expected at least one, found an empty list.")
        self._scenarios = [_drivable(each) for each in listed]
        self._parameters, self._car_name = load_parameters(car), str(car)
        self._friction = (
            None
            if friction is None
            else _range("friction", friction, LEAST_FRICTION, MOST_FRICTION)
        )
        self._mass_factor = _range("mass_factor", mass_factor, *MASS_FACTORS)
        _, self._start_ey_m = _range("start_ey_m", start_ey_m, 0.0, LARGEST_START_EY_M)
        self.observation_space = Box(-_HIGHEST, _HIGHEST)
        self.action_space = Box(-1.0, 1.0, (2,))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """The car at the start of a scenario, settled; all that is random is drawn from `seed`.

        Raises:
            ConfigError: the car cannot drive on the road of the scenario.
        """
        super().reset(seed=seed)
        draw = self.np_random
        scenario = self._scenarios[draw.integers(len(self._scenarios))]
        mass_factor = draw.uniform(*self._mass_factor)
        friction = None if self._friction is None else draw.uniform(*self._friction)
        ey_m = scenario.initial.ey_m + draw.uniform(-self._start_ey_m, self._start_ey_m)
        initial = scenario.initial.model_copy(update={"ey_m": ey_m})
        scenario = replace(scenario.with_friction(friction), initial=initial)
        payload = Payload(*dict(scenario.payload).values())
        loaded = with_payload(with_mass_factor(self._parameters, mass_factor), payload)
        ground = ground_at(scenario.road_at(scenario.start.s_m, 0.0))
        parameters = with_road(loaded, ground)
        self._car = build_car(scenario, OwnCar(parameters, self._car_name))
        self._run = ScenarioRun(scenario, self._car.state, self._car.s_m)
        first = self._car.first_input
        self._commanded = self._before = self._applied = first
        self._under_way = deque([first] * sum(DEFAULT_DELAY))
        self._drawn = {"friction": ground.friction_left, "mass_factor": mass_factor}
        return self._observe(), self._info()

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """One period. The reward is from 0 to 1: 1 less the squares of errors and changes.

        Terminated: the car has left its lane, spins, is much too slow or fast, or its motion is
        not finite. Truncated: the scenario is over.
        """
        run = self._run
        self._before, self._commanded = self._commanded, self._command(action)
        self._under_way.append(self._commanded)
        self._applied = self._under_way.popleft()
        is_sound = run.drive(self._car, self._applied, Mode.NOMINAL)
        errors = self._errors()
        is_lost = not is_sound or any(
            abs(error) > most for error, most in zip(errors, LARGEST, strict=True)
        )
        is_over = run.end_ticks > 0
        info = self._info()
        if is_lost or is_over:
            info["ey_rms_m"], info["ey_peak_m"] = run.ey_error_rms_and_peak_m()
        return self._observe(), 0.0 if is_lost else self._reward(errors), is_lost, is_over, info

    def _command(self, action: Floats) -> ControlInput:
        """The input that an action asks for, within bounds and rates."""
        pedals, wheel = np.clip(action, -1.0, 1.0).tolist()
        most_rad = LIMITS_OF.geometry.largest_wheel_rad(
            self._run.state.vx_mps, LIMITS_OF.plan_lateral_mps2, LIMITS_OF.largest_lateral_mps2
        )
        full_n = INPUT_LIMITS.upper.brake_n
        wanted = ControlInput(max(pedals, 0.0), full_n * max(-pedals, 0.0), wheel * most_rad)
        return limit(wanted, self._commanded, INPUT_LIMITS.with_wheel(most_rad))

    def _errors(self) -> Errors:
        state, path = self._run.state, self._run.path
        turned_rad = state.epsi_rad - atan(path.c1)
        return Errors(self._run.ey_error_m, turned_rad, state.vx_mps - path.v_mps)

    def _reward(self, errors: Errors) -> float:
        shares = np.array(errors) / SCALE
        changes = (np.array(self._commanded) - self._before) / _FASTEST_CHANGE
        return 1.0 - min(float(shares @ shares + CHANGE_WEIGHT * changes @ changes), 1.0)

    def _observe(self) -> Floats:
        run = self._run
        state, path = run.state, run.path
        road = run.scenario.preview_ahead(run.s_m, state.vx_mps, path.v_mps, run.time_s)
        spacing_m, *road_per_m = road
        path_per_m = [
            per_m + 2.0 * path.c2_per_m + 6.0 * path.c3_per_m2 * place * spacing_m
            for place, per_m in enumerate(road_per_m)
        ]
        motion = state.vx_mps, state.vy_mps, state.yaw_rate_radps
        wanted = path.v_mps, path.a_mps2, spacing_m
        inputs = *self._commanded, *self._before
        seen = ObservedValues._make((*motion, *self._errors()[:2], *wanted, *path_per_m, *inputs))
        return np.clip(np.array(seen, dtype=np.float32), -_HIGHEST, _HIGHEST)

    def _info(self) -> dict[str, Any]:
        """True errors and the input that acted in the period."""
        return {
            "time_s": self._run.time_s,
            "s_m": self._run.s_m,
            **self._errors()._asdict(),
            **self._applied._asdict(),
            **self._drawn,
        }


def _drivable(scenario: str | Path | Scenario) -> Scenario:
    found = scenario if isinstance(scenario, Scenario) else load_scenario(str(scenario))
    if found.faults:
        raise ConfigError(
            f"scenario {found.name}: expected one without [[faults]], found {len(found.faults)}. "
            f"Faults act on a bus, which the environment does not have; use `simulate`."
        )
    return found


def _range(name: str, found: Range, low: float, high: float) -> tuple[float, float]:
    first, last = (found, found) if isinstance(found, float | int) else (found[0], found[-1])
    if not low <= first <= last <= high:
        raise ConfigError(
            f"{name}: expected a number of {low:g} to {high:g}, or two of them in "
            f"ascending order, found {found}."
        )
    return first, last


gymnasium.register(ENV_ID, entry_point=f"{__name__}:{CarEnv.__name__}")

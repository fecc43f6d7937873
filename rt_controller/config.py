"""What a person may set, with units and bounds; on the command line, in TOML, or not at all."""

import os
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import Field, model_validator

from rt_controller.contract.car import CAR_VALUES
from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.contract.timing import HOLD_PLAN_TICKS, PERIOD_MS
from rt_controller.settings_table import Settings

if TYPE_CHECKING:
    from rt_controller.control.eq14 import TrackingCost
    from rt_controller.model.bundle import Bundle


ShippedModel = Literal["mdk-net", "mdk-net-small", "mdk-net-paper", "lti"]


def is_model(name: str) -> bool:
    """True if a name is that of a shipped model or of the folder of a bundle."""
    return name in get_args(ShippedModel) or (Path(name) / "koopman.npz").is_file()


_Tolerance = Annotated[float, Field(ge=1e-6)]
"""a smaller one would be a weight that rounding cannot tell from infinity"""


class Tolerances(Settings):
    """Deviations from the reference that cost one unit each: a smaller one has a larger weight."""

    vx_mps: _Tolerance = 0.6
    """longitudinal speed"""
    vy_mps: _Tolerance = float("inf")
    """lateral speed; inf: no weight"""
    yaw_rate_radps: _Tolerance = float("inf")
    """yaw rate; inf: no weight"""
    ds_m: _Tolerance = float("inf")
    """progress in one period; inf: no weight, since the speed has one"""
    ey_m: _Tolerance = 0.1
    """lateral error"""
    epsi_deg: _Tolerance = 4.3
    """error of the course, or of the heading"""
    throttle: _Tolerance = float("inf")
    """size of the throttle input; inf: no weight"""
    brake_n: _Tolerance = float("inf")
    """size of the brake force"""
    steer_deg: _Tolerance = float("inf")
    """size of the steering-wheel angle"""
    throttle_change: _Tolerance = 0.1
    """change of throttle in one period"""
    brake_change_n: _Tolerance = 30.0
    """change of brake force in one period"""
    steer_change_deg: _Tolerance = 10.0
    """change of the steering-wheel angle in one period"""


class MpcSettings(Settings):
    """The optimal control problem."""

    preset: Literal["course", "paper"] | None = None
    """values of all settings below that are not given: course, the defaults, or paper, the printed
    cost over half a second; none: paper for a linear model, course for any other one"""
    horizon: Annotated[int, Field(ge=HOLD_PLAN_TICKS + 1, le=160)] = 40
    """stages of one period each; beyond the reach of the path on the bus it is extrapolated, and
    the road's curvature constant"""
    knots: Annotated[int, Field(ge=HOLD_PLAN_TICKS + 1, le=160)] | None = None
    """planned values of each input, with straight lines between them: at first one every two
    periods, later one every four; none: one in each period up to 20 periods, otherwise
    about a third"""
    heading: Literal["course", "epsi"] = "course"
    """angle that follows the direction of the path: course, the change of e_y over the distance, or
    epsi, as printed in the paper"""
    terminal_factor: Annotated[float, Field(gt=0.0, le=1e6)] = 7.0
    """weight of the last stage, in units of the others"""
    disturbance_gain: Annotated[float, Field(ge=0.0, le=0.5)] = 0.12
    """share of the lateral motion that the model did not predict that becomes an estimated
    disturbance in one period: larger for a road or load that the model does not know, smaller for a
    model with large errors, such as a linear one; the steering factor is learned as fast"""
    corridor_m: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    """distance from the path beyond which the plan has an additional cost; none: no such cost"""
    beyond_corridor_m: Annotated[float, Field(ge=1e-6, le=100.0)] = 0.05
    """distance beyond the corridor that costs as much as a tolerated deviation of a state"""
    actuation_delay: Annotated[int, Field(ge=0, le=8)] = 1
    """periods after which the actuators of the car follow a command that it has accepted; the delay
    of the bus is measured"""
    tolerance: Tolerances = Tolerances()

    def for_model(self, bundle: "Bundle") -> "MpcSettings":
        """The same, with the values of its preset where none was chosen."""
        is_linear = bundle.gains is None
        if (self.preset or ("paper" if is_linear else "course")) != "paper":
            return self
        paper = {
            "horizon": 20,
            "heading": "epsi",
            "terminal_factor": 1.0,
            "disturbance_gain": 0.015,
        }
        # Eq. (14) as printed; the predictions of linear models are too wrong for tighter ones.
        tolerances = {
            "vx_mps": 1.0,
            "ey_m": 0.15,
            "epsi_deg": 1.0,
            "throttle_change": 0.3,
            "brake_change_n": 45.0,
            "steer_change_deg": 12.0,
        }
        tolerance = self.tolerance.model_dump(exclude_unset=True)
        return self.model_copy(
            update={
                **paper,
                **self.model_dump(exclude_unset=True),
                "tolerance": Tolerances(**{**tolerances, **tolerance}),
            }
        )

    def cost(self) -> "TrackingCost":
        """The same in SI units, in vector order."""
        from rt_controller.control.eq14 import TrackingCost

        t = self.tolerance
        return TrackingCost(
            state=VehicleState(
                t.vx_mps, t.vy_mps, t.yaw_rate_radps, t.ds_m, t.ey_m, radians(t.epsi_deg)
            ),
            control=ControlInput(t.throttle, t.brake_n, radians(t.steer_deg)),
            control_change=ControlInput(
                t.throttle_change, t.brake_change_n, radians(t.steer_change_deg)
            ),
            terminal_factor=self.terminal_factor,
            heading=self.heading,
        )


def _of_car(name: str) -> Any:
    """A value of the car that the model's car need not have."""
    low, high, default, doc = CAR_VALUES[name]
    of_model = "as the model predicts"
    if default is not None:
        of_model = f"that of the model's car, otherwise {default:.4g}"
    return Field(None, ge=low, le=high, description=f"{doc}; none: {of_model}")


class LowSpeedSettings(Settings):
    """The car below the speed at which the model drives: start, stop and hold."""

    below_mps: Annotated[float, Field(ge=0.5, le=10.0)] = 8.0
    """the model stops driving below this speed, and drives again 1 m/s above it"""
    wheelbase_m: float | None = _of_car("wheelbase_m")
    rear_axle_m: float | None = _of_car("rear_axle_m")
    steering_ratio: float | None = _of_car("steering_ratio")
    lock_rad: float | None = _of_car("lock_rad")
    throttle_mps2: float | None = _of_car("throttle_mps2")
    brake_mps2_per_n: float | None = _of_car("brake_mps2_per_n")
    hold_mps2: Annotated[float, Field(ge=0.5, le=8.0)] = 4.0
    """force of the brake at a standstill, as the deceleration that it would give: 4 holds the car
    on slopes up to 40 %"""


class RealtimeSettings(Settings):
    """How the loop runs on this machine."""

    priority: Annotated[int, Field(ge=0, le=99)] = 50
    """SCHED_FIFO priority, where the system allows it; 0: none"""
    cpu: Annotated[int, Field(ge=0, lt=os.cpu_count() or 1)] | None = None
    """bind the loop to this core"""
    phase_ms: Annotated[float, Field(ge=0.0, lt=PERIOD_MS)] = 2.0
    """how long after the vehicle's frames each tick is scheduled"""
    prepare_ms: Annotated[float, Field(ge=0.0, lt=PERIOD_MS)] = 8.0
    """how long before each tick its QP is built; dry runs follow at 2.4, 1.5 and 0.8 ms before the
    tick, those of them that are later; 0: neither"""
    solve_budget_ms: Annotated[float, Field(gt=0.0, le=PERIOD_MS)] = 5.0
    """time for a solve; PIQP may do as many iterations as fit at start"""
    deadline_ms: Annotated[float, Field(gt=0.0, le=PERIOD_MS)] = 10.0
    """time from the scheduled tick until the command has been sent; a later one is a miss"""


class ControllerConfig(Settings):
    """Everything that the controller is built from."""

    model: ShippedModel | str | Path | None = None
    """a shipped model, or folder of a bundle, ./lti for a folder with the name of a shipped one;
    default: mdk-net"""
    controller: Annotated[str, Field(min_length=1)] | None = None
    """what plans the inputs: a model as of --model, stanley, bicycle-mpc, or a class with a method
    control as MODULE:CLASS or FILE.py:CLASS; default: MPC with the model. The checks use the model
    with every one of them"""
    plan: Literal["python", "native"] = "python"
    """python: numpy and PIQP; native: the same law in C, as offline-export --target c exports it,
    and PIQP solves each QP again: the car is stopped where the first inputs differ"""
    mpc: MpcSettings = MpcSettings()
    low_speed: LowSpeedSettings = LowSpeedSettings()
    realtime: RealtimeSettings = RealtimeSettings()

    @model_validator(mode="before")
    @classmethod
    def _take_model(cls, found: Any) -> Any:
        """A controller that is a model is the MPC with that model."""
        controller = found.get("controller") if isinstance(found, dict) else None
        if controller is None:
            return found
        if not is_model(str(controller)):
            if found.get("plan") == "native":
                raise ValueError(
                    f"plan: expected python, since {controller} is no model, found native. Leave "
                    f"out one of them."
                )
            return found
        model = found.get("model")
        if model not in (None, controller):
            raise ValueError(
                f"controller: expected no other model than {controller}, which it is, found {model}"
            )
        return {**found, "controller": None, "model": controller}


def require_config(config: ControllerConfig | None) -> ControllerConfig:
    """The same settings; the default ones for None.

    Raises:
        TypeError: something else, such as a dict.
    """
    if config is None:
        return ControllerConfig()
    if not isinstance(config, ControllerConfig):
        raise TypeError(
            f"config: expected a ControllerConfig, found {type(config).__name__}. Write it like "
            f"ControllerConfig(mpc=MpcSettings(horizon=10))."
        )
    return config

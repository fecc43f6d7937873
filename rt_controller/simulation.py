"""A simulated drive as a function: scenario, plant and model in, table of the drive out."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from itertools import count
from math import inf
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError
from threadpoolctl import threadpool_limits

from rt_controller.config import ControllerConfig, is_model, require_config
from rt_controller.contract.errors import ConfigError, PlantError, require_type
from rt_controller.contract.settings_errors import dotted, explain
from rt_controller.contract.signals import StateColumn
from rt_controller.control.law import ControlLaw
from rt_controller.control.low_speed import LowSpeedCar
from rt_controller.control.planner import Planner
from rt_controller.controllers import law_error, require_law
from rt_controller.drive.scenario import DrivenScenario, LateralError, Outline, RoadLine
from rt_controller.drive.table import Drive, PredictedPath
from rt_controller.model.artifact import find_model, load_bundle
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_planner
from rt_controller.realtime.clock import LockstepClock
from rt_controller.safety.checks import Check
from rt_controller.session import ControllerSession
from rt_controller.settings import MODEL, OWN, VIRTUAL, BusSettings, CarSettings

if TYPE_CHECKING:
    from sim_bridge.plant.protocol import Plant
    from sim_bridge.scenario import Scenario
    from sim_bridge.session import BridgeSession


BEHIND_M, AHEAD_M, ROAD_STEP_M = 20.0, 100.0, 0.5
"""of the road that a drive keeps: behind its start, ahead of its end, between two places"""
TICKS_PER_HORIZON = 4
_LONGEST_WAIT_S = 10.0
_numbers = count()


def open_virtual_car(
    bus: BusSettings,
    settings: CarSettings,
    plant: "Plant | None" = None,
    scenario: "Scenario | None" = None,
) -> "BridgeSession":
    """Settle the car, and open its end of the bus.

    `plant` and `scenario` replace those that the settings name.

    Raises:
        MissingExtraError: the car is not compiled, or the plant's dependencies are not installed.
        ConfigError: there is no such scenario or plant.
        PlantError: the plant raised an exception in its reset or first step.
        BusError: the bus cannot be opened.
    """
    from sim_bridge.session import open_session

    return open_session(
        bus, scenario or settings.scenario, plant=plant or settings, faults=settings.faults
    )


def named_scenario(car: CarSettings) -> "Scenario":
    """The scenario that the settings name, read and checked; their faults are checked too.

    Raises:
        MissingExtraError: the car is not compiled.
        ConfigError: there is no such scenario, or it is refused.
    """
    from sim_bridge.scenario.loading import add_faults, load_scenario

    scenario = load_scenario(car.scenario)
    if car.faults is not None:
        add_faults(scenario, car.faults)
    return scenario


def driven_scenario(car: "BridgeSession") -> DrivenScenario:
    """What the car of a session drives."""
    scenario, course = car.bridge.scenario, car.bridge.scenario.course
    road, start_m = scenario.road, scenario.start.s_m
    s_m = np.arange(start_m - BEHIND_M, car.bridge.run.s_m + AHEAD_M, ROAD_STEP_M)
    half_width_m = np.full_like(s_m, np.nan) if road.width_m is None else 0.5 * road.width_m(s_m)
    return DrivenScenario(
        name=scenario.name,
        plant=car.bridge.plant_name,
        friction=scenario.road.uniform_friction,
        cones=course.cones,
        lanes=course.lanes,
        road=RoadLine(s_m, road.curvature_per_m(s_m), half_width_m),
        body=Outline(course.body.front_m, course.body.rear_m, course.body.width_m),
    )


def finished_drive(
    session: ControllerSession, car: "BridgeSession", horizons: Sequence[PredictedPath] = ()
) -> Drive:
    """The drive of a session with the car, its scenario and true poses."""
    poses = car.bridge.poses_at(session.record.trace.times_ns)
    return session.drive().of_scenario(
        driven_scenario(car), car.bridge.figures(), car_error(car), poses, tuple(horizons)
    )


def predicted_path(planner: Planner, tick: int) -> list[PredictedPath]:
    """Where the plan of this tick takes the car, counted from it; only of every fourth tick."""
    states = planner.predicted_states() if tick % TICKS_PER_HORIZON == 0 else None
    if states is None:
        return []
    moved_m, ey_m = states[:, StateColumn.ds_m], states[:, StateColumn.ey_m]
    begin_m = (planner.periods_under_way - 1) * moved_m[0]
    return [PredictedPath(tick, begin_m + np.cumsum(moved_m), ey_m)]


def record_predictions(
    session: ControllerSession,
    after_tick: Callable[[ControllerSession], None] = lambda session: None,
) -> list[PredictedPath]:
    """Where the plan of every fourth tick takes the car, counted from it: grows with the drive.

    It allocates memory: not for a loop in real time. `after_tick` is called after each tick.
    """
    planner, horizons = session.planner, list[PredictedPath]()

    def observe(session: ControllerSession) -> None:
        horizons.extend(predicted_path(planner, session.record.trace.last_tick))
        after_tick(session)

    session.observe = observe
    return horizons


def car_error(car: "BridgeSession") -> LateralError:
    """Lateral error of the car of a session so far, as the simulation has it."""
    summary = car.bridge.summary()
    return LateralError(summary.ey_rms_m, summary.ey_peak_m)


def scenario_notes(
    car: "BridgeSession", friction: float | None, model: Bundle, known: LowSpeedCar
) -> Iterator[str]:
    """Sentences about what the scenario asks of this friction, if one is set, model and car."""
    from sim_bridge.scenario_checks import notes

    scenario, has_own_friction = car.bridge.scenario, friction is not None
    yield from notes(scenario, has_own_friction, model, known.geometry, known.model_rad)
    kind, _, folder = car.bridge.plant_name.partition(":")
    if kind == MODEL and load_bundle(find_model(folder)).sha256 == model.sha256:
        yield (
            "the car is the model of the controller, so the drive shows no error of the model. "
            "Another model or a simulated car as --plant shows it."
        )


def car_settings_of(**values: Any) -> CarSettings:
    """The settings of these values.

    Raises:
        ConfigError: all refused values, each by its name.
    """
    try:
        return CarSettings.model_validate(values)
    except ValidationError as refused:
        raise ConfigError(explain(refused, dotted, CarSettings)) from None


def simulate(
    scenario: "str | Path | Scenario" = "double_lane_change",
    *,
    controller: str | ControlLaw | None = None,
    model: str | Path | Bundle | None = None,
    plant: "str | Plant" = "own",
    car: str | Path | None = None,
    friction: float | None = None,
    faults: str | Path | None = None,
    config: ControllerConfig | None = None,
    duration_s: float | None = None,
) -> Drive:
    """Drive a scenario with a simulated car, in simulated time, over a virtual CAN bus.

    The program is `rt-controller`, with its frames, checks and modes, whatever the controller. The
    same arguments give the same drive on every machine.

    Args:
        scenario: name of a shipped scenario, path of a .toml or .xodr file, or a
            `sim_bridge.Scenario`.
        controller: what plans the inputs: a model as `model`, "stanley", "bicycle-mpc",
            "MODULE:CLASS", "FILE.py:CLASS", or a `ControlLaw`; default: the MPC with the model.
        model: name of a shipped model, folder of a bundle, or a `Bundle`; default: mdk-net. The
            checks use it with every controller.
        plant: "own", "fmu:FILE.fmu", "commonroad:NUMBER", "model:BUNDLE", or an object that
            implements `Plant`.
        car: parameters of the own car: a shipped name, or path of a .toml file.
        friction: of the road; default: the scenario's.
        faults: path of a .toml file with faults of bus and actuators; added to the scenario's.
        config: settings of the controller; `model` overrides its model.
        duration_s: request the stop after this time; braking to rest follows and is part of the
            drive and of its errors. Default: the scenario's end.

    Raises:
        ConfigError: scenario, plant, car or settings are refused.
        ArtifactError: the model does not fit.
        MissingExtraError: the car is not compiled, or an extra that the plant needs is missing.
        ControlLawError: the controller raised an exception, or returned no input: then its cause.
        PlantError: the plant failed during the drive, or raised an exception: then its cause.
        TypeError: an argument is of another type.
    """
    if not isinstance(scenario, str | Path):
        from sim_bridge.scenario import Scenario

        expected = "the name or path of a scenario, or a sim_bridge.Scenario"
        require_type("scenario", scenario, Scenario, expected)
    require_type("car", car, str | Path | None, "the name or path of a car")
    require_type("faults", faults, str | Path | None, "the path of a file of faults")
    require_type("friction", friction, Real | None, "one number")
    require_type("duration_s", duration_s, Real | None, "one number")
    if duration_s is not None and not 0.0 < duration_s < inf:
        raise ConfigError(f"duration_s: expected a finite time above 0 s, found {duration_s}.")
    settings = require_config(config)
    named = {"model": model} if isinstance(model, str | Path) else {}
    law: ControlLaw | None = None
    if isinstance(controller, str):
        named["controller"] = controller
    elif controller is not None:
        law = require_law(controller)
    settings = ControllerConfig(**{**dict(settings), **named})
    bundle = model if isinstance(model, Bundle) else Bundle.load(settings.model)
    if isinstance(model, Bundle) and isinstance(controller, str) and is_model(controller):
        raise ConfigError(
            f"model: expected none beside the controller {controller}, which is a model, found "
            f"the bundle {model.name}."
        )
    planner = build_planner(bundle, settings, law)
    car_settings = car_settings_of(
        **({"scenario": str(scenario)} if isinstance(scenario, str | Path) else {}),
        plant=plant if isinstance(plant, str) else OWN,
        car=None if car is None else str(car),
        friction=friction,
        faults=faults,
    )
    own_plant = None if isinstance(plant, str) else plant
    own_scenario = None if isinstance(scenario, str | Path) else scenario
    return drive_in_lockstep(
        settings, bundle, planner, car_settings, own_plant, duration_s, own_scenario
    )


def drive_in_lockstep(
    config: ControllerConfig,
    bundle: Bundle,
    planner: Planner,
    car: CarSettings,
    plant: "Plant | None" = None,
    duration_s: float | None = None,
    scenario: "Scenario | None" = None,
    checks: Sequence[Check] | None = None,
    after_tick: Callable[[ControllerSession], None] = lambda session: None,
) -> Drive:
    """A drive in simulated time with `planner`, over a bus of its own; the checks use `bundle`.

    `plant` and `scenario` replace those that `car` names; `checks` are those of the supervisor;
    `after_tick` is called after each step; otherwise as `simulate`.
    """
    bus = BusSettings(bus=VIRTUAL, channel=f"simulate-{next(_numbers)}")
    with (
        closing(open_virtual_car(bus, car, plant, scenario)) as virtual,
        threadpool_limits(1, "blas"),
    ):
        clock = LockstepClock(virtual.tick)
        with closing(
            ControllerSession(bus, config, bundle, planner, clock, checks=checks)
        ) as session:
            horizons = record_predictions(session, after_tick)
            session.start(duration_s, False, _LONGEST_WAIT_S).join()
    failure = law_error(planner) or session.failure  # a law that fails at once never drives
    if failure is not None:
        raise failure
    plant_failure = virtual.bridge.summary().plant_failure
    if plant_failure is not None:
        raise PlantError(f"The plant failed during the drive: {plant_failure}.")
    return finished_drive(session, virtual, horizons)

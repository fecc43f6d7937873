"""A short drive of the simulated car with a model, before the model drives another one.

Matching files and unchanged plans do not show that the model is one of a car. The drive
accelerates, brakes, and changes the lane on a straight road and in a bend. With feedback also many
wrong models track the path, so the predictions of the model are compared with the motion too. A
model that has passed once on this machine, with the same settings, is not tried again.
"""

import hashlib
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rt_controller.config import ControllerConfig
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError, BusError, MissingExtraError
from rt_controller.contract.files import is_marked, mark
from rt_controller.contract.signals import N_STATES, VEHICLE, ControlInput, Mode, VehicleState
from rt_controller.control.lift import Encoder, History
from rt_controller.drive.table import Drive
from rt_controller.loop import Ending
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import roll_out
from rt_controller.simulation import simulate

SCENARIO = Path(__file__).with_name("model_trial.toml")
PREDICTED_PERIODS = 20
FOLDER = "tried-models"
NOT_TRIED = (
    "the model was not tried on the simulated car, which is not compiled here. Try it where "
    "that is: rt-controller --bus virtual --check"
)


class TrialFigures(NamedTuple):
    """Figures with a limit: two tracking errors, and errors of the prediction over 0.5 s."""

    ey_peak_m: float
    vx_peak_mps: float
    vx_prediction_rms_mps: float
    yaw_rate_prediction_rms_radps: float
    epsi_prediction_rms_rad: float


LARGEST = TrialFigures(0.75, 1.5, 0.45, 0.045, 0.013)
"""at least 1.4 times the figures of the worst shipped model, and of one of `--preset quick`
(decision 037)"""


def has_passed(bundle: Bundle, config: ControllerConfig) -> bool:
    """True if the model has passed its trial on this machine with the same settings."""
    return is_marked(FOLDER, _name_of_trial(bundle, config))


def try_model(bundle: Bundle, config: ControllerConfig) -> str | None:
    """Drive the simulated car with a model; a remark where that is not compiled, otherwise None."""
    try:
        drive = drive_trial(bundle, config)
    except MissingExtraError:
        return NOT_TRIED
    require_passed(drive, bundle)
    mark(FOLDER, _name_of_trial(bundle, config))
    return None


def drive_trial(bundle: Bundle, config: ControllerConfig | None = None) -> Drive:
    """The short drive of the simulated car."""
    try:
        return simulate(SCENARIO, model=bundle, config=config)
    except BusError as error:
        raise ArtifactError(
            f"The model {bundle.name}: expected it to hold and to predict the simulated car in a "
            f"short drive, found none: {error} Choose another `model`."
        ) from error


def require_passed(drive: Drive, bundle: Bundle) -> None:
    """Return if a drive of the trial is one of a good model."""
    found = trial_figures(drive, bundle)
    rows = list(zip(LARGEST._fields, found, LARGEST, strict=True))
    is_within = all(figure <= limit for _, figure, limit in rows)
    if is_within and drive.ending == Ending.MISSION_OVER.value:
        return
    figures = ", ".join(f"{name} {figure:.3g} (at most {limit:g})" for name, figure, limit in rows)
    raise ArtifactError(
        f"The model {drive.model}: expected it to hold and to predict the simulated car in a short "
        f"drive, found {figures} and the end {drive.ending!r}. Choose another `model`; only for a "
        f"car that differs much from the simulated one, drive without this test: "
        f"--model-trial off."
    )


def trial_figures(drive: Drive, bundle: Bundle) -> TrialFigures:
    """The figures of a drive; those of the prediction are NaN if no 0.5 s were driven nominally."""
    errors = prediction_errors(drive, bundle)
    rms = np.sqrt(np.mean(np.square(errors), axis=0)) if len(errors) else np.full(N_STATES, np.nan)
    of, tracking = VehicleState(*rms.tolist()), drive.errors
    return TrialFigures(
        tracking.ey_peak_m, tracking.vx_peak_mps, of.vx_mps, of.yaw_rate_radps, of.epsi_rad
    )


def prediction_errors(drive: Drive, bundle: Bundle) -> Array:
    """State predicted by roll-outs of 0.5 s minus measured one (starts, 6).

    A roll-out begins in each tick around which the drive was nominal, with the inputs that were
    sent.
    """
    states, inputs, curvature = (
        np.stack([drive[name] for name in names], axis=1)
        for names in (VEHICLE.state_names, VEHICLE.input_names, VEHICLE.exogenous_names)
    )
    is_good = (drive["mode"] == Mode.NOMINAL) & np.isfinite(states).all(axis=1)
    needed, steps = 1 + bundle.lift.history_steps, PREDICTED_PERIODS
    is_whole = np.convolve(is_good, np.ones(needed + steps)) == needed + steps
    starts = np.flatnonzero(is_whole) - steps
    if len(starts) == 0:
        return np.empty((0, N_STATES))
    encoder = Encoder(bundle)
    history = None if encoder.history is None else History(encoder.history)
    psi = np.empty((len(states), bundle.n_observables))
    for k, x in enumerate(states):
        state = VehicleState(*x.tolist())
        if history is not None:
            history.advance(state, ControlInput(*inputs[max(k - 1, 0)].tolist()))
        psi[k] = encoder.lift(state, float(curvature[k, 0]))
    ahead = starts[:, None] + np.arange(steps)
    predicted = roll_out(bundle, psi[starts], inputs[ahead], curvature[ahead], N_STATES)
    errors: Array = predicted[:, -1] - states[starts + steps]
    return errors


def _name_of_trial(bundle: Bundle, config: ControllerConfig) -> str:
    """Hash of all that the trial depends on: version, model, settings, drive and limits."""
    settings = config.model_dump_json(include={"mpc", "low_speed"})
    scenario = SCENARIO.read_text("utf-8")
    words = (version("rt-controller"), bundle.sha256, settings, scenario, str(LARGEST))
    return hashlib.sha256(" ".join(words).encode()).hexdigest()

"""A short drive of the simulated car with a model, before its bundle is written.

Matching files and unchanged plans do not show that the model is one of a car. The drive
accelerates, brakes, and changes the lane on a straight road and in a bend. With feedback also many
wrong models track the path, so the predictions of the model are compared with the motion too.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from offline.model.bundle_predictor import BundlePredictor
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError, BusError, MissingExtraError
from rt_controller.contract.signals import N_STATES, VEHICLE, Mode, VehicleState
from rt_controller.drive.table import Drive
from rt_controller.model.bundle import Bundle
from rt_controller.model.validation import find_objection_to_driving
from rt_controller.simulation import simulate

SCENARIO = Path(__file__).with_name("model_trial.toml")
PREDICTED_PERIODS = 20
NOT_TRIED = "not tried on the simulated car: --model-trial off"


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


def try_model(bundle: Bundle) -> tuple[str, TrialFigures | None]:
    """The result of the drive as a sentence, and its figures; None: the model was not tried.

    A model of logs is not: the simulated car is another one.

    Raises:
        ArtifactError: the model does not hold or does not predict the simulated car.
    """
    if find_objection_to_driving(bundle) is not None:
        return "not tried on the simulated car: it cannot be driven with", None
    if _is_imported(bundle):
        return "not tried on the simulated car: its data are logs of another", None
    try:
        drive = simulate(SCENARIO, model=bundle)
    except MissingExtraError:
        return "not tried on the simulated car, which is not compiled here", None
    except BusError as error:
        raise ArtifactError(
            f"The model {bundle.name}: expected it to hold and to predict the simulated car in a "
            f"short drive, found none: {error}"
        ) from error
    found = trial_figures(drive, bundle)
    return f"holds the simulated car: {require_passed(drive, found)}", found


def _is_imported(bundle: Bundle) -> bool:
    """True if the training data of a bundle are logs, as `offline.data.manifest` notes it."""
    try:
        return bool(json.loads(bundle.training)["data"] == "imported")
    except (ValueError, KeyError, TypeError):
        return False


def require_passed(drive: Drive, found: TrialFigures) -> str:
    """The figures as text, if a drive of the trial is one of a good model.

    Raises:
        ArtifactError: it is not.
    """
    rows = list(zip(LARGEST._fields, found, LARGEST, strict=True))
    figures = ", ".join(f"{name} {figure:.3g} (at most {limit:g})" for name, figure, limit in rows)
    is_within = all(figure <= limit for _, figure, limit in rows)
    if is_within and drive.stop_cause == "NONE":
        return figures
    raise ArtifactError(
        f"The model {drive.model}: expected it to hold and to predict the simulated car in a short "
        f"drive, found {figures} and the end {drive.ending!r}. Train longer, or on more data; only "
        f"for a car that differs much from the simulated one export it nonetheless: "
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
    states, inputs, curvature, history = (
        np.array([drive[name] for name in names]).reshape(len(names), len(drive)).T
        for names in (
            VEHICLE.state_names,
            VEHICLE.input_names,
            VEHICLE.exogenous_names,
            bundle.lift.history_fields,
        )
    )
    is_good = (drive["mode"] == Mode.NOMINAL) & np.isfinite(states).all(axis=1)
    before, steps = bundle.lift.history_steps, PREDICTED_PERIODS
    length = before + 1 + steps
    is_whole = np.convolve(is_good, np.ones(length)) == length
    starts = np.flatnonzero(is_whole)[:, None] - steps
    if len(starts) == 0:
        return np.empty((0, N_STATES))
    ahead, past = starts + np.arange(steps), starts + np.arange(-before, 0)
    predicted = BundlePredictor(bundle).predict(
        states[starts[:, 0]], history[past], inputs[ahead], curvature[ahead]
    )
    errors: Array = predicted[:, -1] - states[starts[:, 0] + steps]
    return errors

"""Signals: the role of each in the learning, and its scale.

The schema of a data set (`rt_controller.contract.signals`) names the signals. `Roles` says which of
them are centred, change sign when left and right are exchanged, and belong to the history.
`Scaling` is fitted once, on the training trajectories. Measurement noise is on what a model reads:
the first state of a prediction, and the past.
"""

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import PATH_STATES, VEHICLE, InputColumn, Schema
from rt_controller.model.dynamics import Matrices
from rt_controller.model.path_kinematics import Movement
from rt_controller.model.validation import DRIVABLE_HISTORY

Array32 = NDArray[np.float32]
Rows = NDArray[np.integer] | NDArray[np.bool_] | slice


class Trajectories(NamedTuple):
    """N trajectories of K steps in physical units, with the H steps before each."""

    x: Array32
    """(N, K+1, n) states"""
    u: Array32
    """(N, K, m) inputs, each held from the state of its step to the next"""
    w: Array32
    """(N, K, p) exogenous signals, held likewise"""
    past: Array32
    """(N, H, h) rows of the history, oldest first: states, and the inputs held after them"""
    episode: NDArray[np.int32]
    """(N,) number of the episode"""

    def take(self, rows: Rows) -> "Trajectories":
        """The trajectories of these rows."""
        x, u, w, past, episode = self
        return Trajectories(x[rows], u[rows], w[rows], past[rows], episode[rows])


Float = TypeVar("Float", bound=np.floating)

INPUT_SHARE_OF_PEAK, STATE_SHARE_OF_PEAK = 1.0 / 3.0, 0.1
"""least scale of a signal, as a share of its largest magnitude"""
CONSTANT_SIGNAL = 1e-12
"""scale below which a signal counts as constant"""


@dataclass(frozen=True, slots=True)
class Roles:
    """Names of the signals that the learning treats specially.

    Raises:
        DatasetError: a signal is centred and changes sign: a mirror image is measured from zero.
    """

    centred: tuple[str, ...]
    """states that are never near zero; their mean is subtracted before scaling"""
    odd: tuple[str, ...] | None
    """change sign when left and right are exchanged; None: the car has no such symmetry"""
    past: tuple[str, ...]
    """states and inputs in one row of the history"""

    def __post_init__(self) -> None:
        both = sorted(set(self.centred) & set(self.odd or ()))
        if both:
            raise DatasetError(
                f"roles: expected each signal either centred or odd, found both for "
                f"{', '.join(both)}. Remove the signal from one of the lists."
            )


VEHICLE_ROLES = Roles(
    centred=("vx_mps", "ds_m"),
    odd=("vy_mps", "yaw_rate_radps", "ey_m", "epsi_rad", "steer_rad", "curvature_per_m"),
    past=DRIVABLE_HISTORY,
)
"""of the car in the Frenet frame; its history leaves out the position relative to the road"""


def has_path(schema: Schema) -> bool:
    """True for the states of a car on a road, whose path follows from the motion by kinematics."""
    return schema.states == VEHICLE.states and schema.exogenous[:1] == VEHICLE.exogenous


def mirror_signs(names: tuple[str, ...], roles: Roles) -> Array:
    """-1 for each named signal that changes sign in a mirror image, otherwise +1."""
    odd = roles.odd or ()
    return np.array([-1.0 if name in odd else 1.0 for name in names])


def past_columns(schema: Schema, roles: Roles) -> tuple[list[int], list[int]]:
    """Columns of the states and of the inputs in one row of the history."""
    return (
        [i for i, name in enumerate(schema.state_names) if name in roles.past],
        [i for i, name in enumerate(schema.input_names) if name in roles.past],
    )


def past_names(schema: Schema, roles: Roles) -> tuple[str, ...]:
    """Names of the signals in one row of the history, in the order of its columns."""
    names = schema.state_names + schema.input_names
    return tuple(name for name in names if name in roles.past)


def last_rows(past: NDArray[Float], steps: int) -> NDArray[Float]:
    """The newest `steps` rows (..., steps, h) of a history (..., H, h), H >= steps."""
    return past[..., past.shape[-2] - steps :, :]


def history_rows(
    windows: Trajectories, schema: Schema, roles: Roles, past_steps: int
) -> NDArray[np.float32]:
    """Rows of the history (N, past_steps + K, h), from `past_steps` before the start to the end."""
    states, inputs = past_columns(schema, roles)
    current = np.concatenate([windows.x[:, :-1, states], windows.u[..., inputs]], axis=-1)
    return np.concatenate([last_rows(windows.past, past_steps), current], axis=1)


@dataclass(frozen=True, slots=True)
class Scaling:
    """Centre and scale of every signal, in physical units."""

    x_centre: Array
    """(n,) states"""
    x_scale: Array
    """(n,)"""
    u_scale: Array
    """(m,) inputs"""
    w_scale: Array
    """(p,) exogenous signals"""
    past_centre: Array
    """(h,) one row of the history"""
    past_scale: Array
    """(h,)"""

    def normalise_states(self, x: NDArray[np.floating]) -> Array:
        """Scaled states (..., n)."""
        return np.asarray((x - self.x_centre) / self.x_scale, dtype=np.float64)

    def to_physical(self, scaled: Matrices) -> Matrices:
        """The model of scaled signals in physical units, for psi = [x; the other observables].

        With psi_n = (psi - t) / s of the scaled model, psi+ = S A S^-1 psi + S B U^-1 u + S c +
        (I - S A S^-1) t, where s and t scale and centre the states and leave the others unchanged.
        The arguments S psi_n of the gains become (S / s) psi - (S / s) t.
        """
        s, t = np.ones(len(scaled.A)), np.zeros(len(scaled.A))
        s[: len(self.x_scale)], t[: len(self.x_scale)] = self.x_scale, self.x_centre
        A = scaled.A * s[:, None] / s[None, :]
        gains = scaled.gains
        if gains is not None:
            N, S = gains.N * s[:, None] / gains.factors(self.u_scale, self.w_scale), gains.S / s
            gains = gains._replace(N=N, S=S, s0=gains.s0 - S @ t)
        c, movement = t + s * scaled.c - A @ t, scaled.movement
        if movement is not None:
            S = movement.S / s
            movement = Movement(S, movement.s0 - S @ t)
            c[PATH_STATES] = 0.0  # not predicted by A
        return Matrices(
            A,
            np.ascontiguousarray(scaled.B_uc * s[:, None] / self.u_scale),
            np.ascontiguousarray(scaled.B_uw * s[:, None] / self.w_scale),
            c,
            gains,
            movement,
        )


def fit_scaling(trajectories: Trajectories, schema: Schema, roles: Roles) -> Scaling:
    """Scaling by the root mean square of these trajectories; 1 for a constant signal.

    The scale is at least a third of the largest magnitude of an input or exogenous signal, and a
    tenth of that of a state: a brake that is rarely pressed would have values of 50 otherwise, and
    a product with it would dominate every prediction.

    Only centred signals are shifted. Elsewhere zero has a meaning (straight ahead, pedal
    released), which scaling keeps, and with it the symmetry of left and right.
    """
    states = _rows(trajectories.x)
    is_centred = np.array([name in roles.centred for name in schema.state_names])
    x_centre = np.where(is_centred, states.mean(axis=0), 0.0)
    x_scale = _scale(states - x_centre, STATE_SHARE_OF_PEAK)
    u_scale = _scale(_rows(trajectories.u), INPUT_SHARE_OF_PEAK)
    past_states, past_inputs = past_columns(schema, roles)
    return Scaling(
        x_centre=x_centre,
        x_scale=x_scale,
        u_scale=u_scale,
        w_scale=_scale(_rows(trajectories.w), INPUT_SHARE_OF_PEAK),
        past_centre=np.concatenate([x_centre[past_states], np.zeros(len(past_inputs))]),
        past_scale=np.concatenate([x_scale[past_states], u_scale[past_inputs]]),
    )


def _rows(series: NDArray[np.floating]) -> Array:
    count = int(np.prod(series.shape[:-1]))
    return np.asarray(series, dtype=np.float64).reshape(count, series.shape[-1])


def signal_range(trajectories: Trajectories, schema: Schema) -> Array:
    """Lowest and highest value (2, m + p) of each input and exogenous signal of these data.

    Of the inputs of the car, these are its limits; the wheel may have been turned further.
    """
    rows = np.concatenate([_rows(trajectories.u), _rows(trajectories.w)], axis=1)
    found = np.stack([rows.min(axis=0), rows.max(axis=0)])
    if schema.inputs == VEHICLE.inputs:
        steer = InputColumn.steer_rad
        largest_rad = max(np.abs(found[:, steer]).max(), INPUT_LIMITS.upper.steer_rad)
        found[:, : len(schema.inputs)] = INPUT_LIMITS.lower, INPUT_LIMITS.upper
        found[:, steer] = -largest_rad, largest_rad
    return found


def _scale(rows: Array, share_of_peak: float) -> Array:
    rms = np.sqrt(np.mean(np.square(rows), axis=0))
    scale = np.maximum(rms, share_of_peak * np.abs(rows).max(axis=0))
    return np.where(scale > CONSTANT_SIGNAL, scale, 1.0)


STANDARD_DEVIATIONS = {
    "vx_mps": 0.03,
    "vy_mps": 0.03,
    "yaw_rate_radps": float(np.radians(0.1)),
    "ey_m": 0.02,
    "epsi_rad": float(np.radians(0.1)),
}
"""by state, at level 1; normally distributed, independent between signals and instants"""
PROGRESS, SPEED = "ds_m", "vx_mps"


def noise_matrix(names: tuple[str, ...], dt_s: float) -> Array:
    """M (len(STANDARD_DEVIATIONS), len(names)): z @ M is noise of level 1 on the named signals.

    z (..., len(STANDARD_DEVIATIONS)) is standard normal. Progress has the noise of the longitudinal
    speed times the period, from which a car computes it.
    """
    matrix = np.zeros((len(STANDARD_DEVIATIONS), len(names)))
    for row, (state, deviation) in enumerate(STANDARD_DEVIATIONS.items()):
        for column, name in enumerate(names):
            if name == state:
                matrix[row, column] = deviation
            elif name == PROGRESS and state == SPEED:
                matrix[row, column] = deviation * dt_s
    return matrix

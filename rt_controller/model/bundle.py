"""The model bundle: everything that training passes to the vehicle.

psi_(k+1) = A psi_k + B_uc u_k + B_uw w_k + c + gains in physical units, where psi = [x; latents] is
what the encoder computes, and the gains are terms that depend on the lifted state.
Paper: eqs. (6)-(8) and (14).
"""

import hashlib
import json
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.car import Car
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS, SteeringGeometry
from rt_controller.contract.signals import VEHICLE, InputColumn, Schema
from rt_controller.model.dynamics import Gains
from rt_controller.model.lift import STATES_ONLY, Lift, LiftSample, identity_encoder
from rt_controller.model.path_kinematics import Movement
from rt_controller.model.validity import TrainedRange, Validity


class PlanSample(NamedTuple):
    """Situations of the car, and what the controller plans in them; float64, SI units.

    For T situations: it repeats the plan of a bundle before it drives with it.
    """

    state: Array
    """(T, n_x)"""
    curvature_per_m: Array
    """(T,) of the road at the car"""
    path: Array
    """(T, 6), each a `PathReference`"""
    previous: Array
    """(T, m), the inputs of the period before"""
    inputs: Array
    """(T, N, m), the plan"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bundle:
    """A lifted model in physical units, with the encoder that lifts into it.

    `n` is the number of observables, the n_x states first; `m` inputs, `p` exogenous signals.
    """

    name: str
    """kind of model, for summaries: "mdk-net", "lti" """
    schema: Schema = VEHICLE
    A: Array
    """(n, n)"""
    B_uc: Array
    """(n, m)"""
    B_uw: Array
    """(n, p)"""
    c: Array
    """(n,), the offset that remains from centring"""
    gains: Gains | None = None
    """None: the model is linear in psi"""
    movement: Movement | None = None
    """that the path follows from by kinematics; None: the path is predicted as all other states"""
    signal_range: Array | None = None
    """(2, m + p), lowest and highest value of each input and exogenous signal that the model was
    made for; None: not known"""
    validity: Validity | None = None
    """ranges of the motion and of the conditions in the training data; None: not known"""
    lift: Lift = STATES_ONLY
    encoder_onnx: bytes
    selftest: LiftSample
    """of b instants"""
    selftest_psi: Array
    """(b, n), the encoder's output for them where it was trained"""
    training: str = "{}"
    """resolved training configuration, JSON"""
    car: Car | None = None
    """that the model is of; None: not known"""
    data_sha256: str = ""
    """hash of the data set it was trained on; empty if there was none"""
    plans: PlanSample | None = None
    """planned where the bundle was exported; None: not stored, or not of a car"""

    @classmethod
    def load(cls, model: "str | Path | Bundle | None" = None) -> "Bundle":
        """The bundle in a folder, or the shipped one of that name.

        Warns where a model of this car has no stored plans. `model` is "mdk-net" (as None is),
        "mdk-net-small", "mdk-net-paper", "lti", a folder that `save` or offline-export wrote, or a
        `Bundle`, which is returned as it is.
        """
        if isinstance(model, Bundle):
            return model
        if not isinstance(model, str | Path | None):
            raise TypeError(
                f"model: expected the name of a shipped model, the folder of a bundle, or a "
                f"Bundle, found {type(model).__name__}."
            )
        from rt_controller.model.artifact import find_model, load_bundle
        from rt_controller.model.validation import explain_missing_plans

        folder = find_model(model)
        bundle = load_bundle(folder)
        missing = explain_missing_plans(bundle, folder)
        if missing:
            warnings.warn(missing, stacklevel=2)
        return bundle

    @classmethod
    def linear(
        cls,
        A: Array,
        B_uc: Array,
        B_uw: Array,
        offset: Array | None = None,
        *,
        name: str = "linear",
        schema: Schema = VEHICLE,
    ) -> "Bundle":
        """A linear model of the states themselves: x_(k+1) = A x_k + B_uc u_k + B_uw w_k + offset.

        All in the units of `schema`, over one of its periods. For the car, x is a `VehicleState`
        (n_x = 6), u a `ControlInput` (m = 3) and w the curvature of the road in 1/m (p = 1).

        A (n_x, n_x), B_uc (n_x, m), B_uw (n_x, p), offset (n_x,) or None: zeros. `name` is the kind
        of model in summaries; `schema` has names, units and period of the signals.
        """
        from rt_controller.model.validation import require_fitting_parts

        n_x, m, p = len(schema.states), len(schema.inputs), len(schema.exogenous)
        offset = np.zeros(n_x) if offset is None else offset
        given = {"A": A, "B_uc": B_uc, "B_uw": B_uw, "offset": offset}
        shapes = ((n_x, n_x), (n_x, m), (n_x, p), (n_x,))
        for (key, matrix), shape in zip(given.items(), shapes, strict=True):
            if np.shape(matrix) != shape:
                raise ArtifactError(f"{key}: expected the shape {shape}, found {np.shape(matrix)}.")
            if not (np.isrealobj(matrix) and np.isfinite(np.asarray(matrix, np.float64)).all()):
                raise ArtifactError(f"{key}: expected finite real numbers, found others.")
        A, B_uc, B_uw, c = (np.array(matrix, np.float64) for matrix in given.values())
        x = np.vstack([np.zeros(n_x), np.ones(n_x)])
        bundle = cls(
            name=name,
            schema=schema,
            A=A,
            B_uc=B_uc,
            B_uw=B_uw,
            c=c,
            encoder_onnx=identity_encoder(n_x),
            selftest=LiftSample(x, np.zeros((2, p)), np.zeros((2, 0, 0))),
            selftest_psi=x.copy(),
            training=json.dumps({"kind": name}),
        )
        require_fitting_parts(bundle, f"the linear model {name!r}")
        return bundle

    def save(self, folder: str | Path, card: str = "") -> Self:
        """Write the bundle to a folder, from which `load` and --model read it; returns itself.

        The folder is made if needed; an existing bundle is replaced file by file, each atomically.
        `card` is the text of the model card, in Markdown.
        """
        from rt_controller.model.artifact import save_bundle

        save_bundle(Path(folder), self, card or f"# {self.name}\n")
        return self

    @property
    def geometry(self) -> SteeringGeometry | None:
        """Of the steering of that car; None: not known."""
        return None if self.car is None else self.car.geometry

    @property
    def n_observables(self) -> int:
        return int(self.A.shape[0])

    @property
    def encoder_sha256(self) -> str:
        return hashlib.sha256(self.encoder_onnx).hexdigest()

    @property
    def sha256(self) -> str:
        """Identity of the model: it changes with everything that a prediction depends on.

        Over name, signals, period, lift, encoder, matrices, and, where they are known, the geometry
        of the car and the range of the signals; not over lock, training, validity and self-test.
        """
        schema, lift, gains = self.schema, self.lift, self.gains
        words = [
            self.name,
            [schema.states, schema.inputs, schema.exogenous, schema.dt_s],
            [lift.inputs, lift.history_steps, lift.history_fields],
            None if gains is None else [gains.follows, gains.factor.tolist(), gains.shape.tolist()],
            self.encoder_sha256,
            *(() if self.car is None else [self.car.geometry[:3]]),
            *(() if self.car is None or not self.car.own_values else [self.car.own_values]),
        ]
        digest = hashlib.sha256(json.dumps(words).encode())
        matrices = {"A": self.A, "B_uc": self.B_uc, "B_uw": self.B_uw, "c": self.c}
        if gains is not None:
            matrices |= {"N": gains.N, "S": gains.S, "s0": gains.s0}
        if self.movement is not None:
            matrices |= {f"movement_{key}": part for key, part in self.movement._asdict().items()}
        if self.signal_range is not None:
            matrices["signal_range"] = self.signal_range
        for key, matrix in matrices.items():
            array = np.ascontiguousarray(matrix, dtype="<f8")
            digest.update(f"{key} {array.shape}\n".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    @property
    def largest_steer_rad(self) -> float:
        """Largest angle of the steering wheel in the training data; at least that of the paper."""
        usual_rad = INPUT_LIMITS.upper.steer_rad
        if self.signal_range is None:
            return usual_rad
        return max(usual_rad, float(self.signal_range[1, InputColumn.steer_rad]))

    @property
    def trained_range(self) -> TrainedRange | None:
        """Compares a motion with that of the training data; None: not known."""
        validity = self.validity
        return None if validity is None else TrainedRange(validity, self.movement is not None)

    @property
    def spectral_radius(self) -> float:
        return spectral_radius_of(self.A)

    @property
    def spread(self) -> Array:
        """(n,) standard deviation of each observable over the self-test instants.

        It scales the observables, since metres, radians and latents share no unit. A constant one
        has its size instead, and 1 if it is zero.
        """
        spread = self.selftest_psi.std(axis=0)
        size = np.abs(self.selftest_psi).max(axis=0)
        least = 1e-6 * size  # with less, float32 cannot tell an observable from a constant
        return np.where(spread > least, spread, np.where(size > 0.0, size, 1.0))

    def growth(self, steps: int) -> float:
        """||A^steps||_2: largest growth of an error after `steps`, in units of `spread`."""
        scale = self.spread
        scaled = self.A * scale[None, :] / scale[:, None]
        return float(np.linalg.norm(np.linalg.matrix_power(scaled, steps), 2))

    def parity_error(self, psi: Array) -> float:
        """Largest difference between psi (b, n), lifted from the self-test, and the stored one.

        In units of `spread`, or of a tenth of the size, to which float32 rounds, if that is more;
        NaN if an entry of psi is NaN.
        """
        unit = np.maximum(self.spread, 0.1 * np.abs(self.selftest_psi).max(axis=0))
        return float(np.max(np.abs(psi - self.selftest_psi) / unit))


def spectral_radius_of(A: Array) -> float:
    """Largest magnitude of an eigenvalue of A (n, n)."""
    return float(np.max(np.abs(np.linalg.eigvals(A))))

"""A bundle with every optional part, and one of other signals than the car's."""

from pathlib import Path

import numpy as np
import pytest

from rt_controller.contract.signals import Schema, Signal
from rt_controller.model.artifact import save_bundle
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Gains, Shape
from rt_controller.model.lift import Lift, LiftSample
from rt_controller.model.validation import DRIVABLE_HISTORY
from rt_controller.model.validity import Validity

FACTOR = np.array([0, 1, 2, 0, 1, 2, 3, 4, 4])
"""throttle, brake, steering, curvature, 1"""
SHAPE = np.array([Shape.LINEAR] * 3 + [Shape.TANH] * 4 + [Shape.SATURATION] * 2)

PLANAR = Schema(
    states=(Signal("vx_mps", "m/s"), Signal("vy_mps", "m/s"), Signal("yaw_rate_radps", "rad/s")),
    inputs=(Signal("steer_rad", "rad"), Signal("force_n", "N")),
    exogenous=(),
    dt_s=0.01,
)


@pytest.fixture
def bundle() -> Bundle:
    """A model of the car: gains of every shape and factor, curvature and history."""
    rng = np.random.default_rng(1)
    n = 9
    return Bundle(
        name="random",
        A=np.eye(n) + 0.01 * rng.normal(size=(n, n)),
        B_uc=rng.normal(size=(n, 3)),
        B_uw=rng.normal(size=(n, 1)),
        c=rng.normal(size=n),
        gains=Gains(
            N=rng.normal(size=(n, len(FACTOR))),
            S=rng.normal(size=(len(FACTOR), n)),
            s0=rng.normal(size=len(FACTOR)),
            factor=FACTOR,
            shape=SHAPE,
        ),
        signal_range=np.array([[0.0, 0.0, -6.0, -0.02], [1.0, 150.0, 6.0, 0.02]]),
        validity=Validity(
            speed_mps=np.array([3.0, 20.0, 40.0]),
            lateral_mps2=np.array([1.0, 8.0, 9.0]),
            steer_rad=np.array([4.0, 2.0, 0.7]),
            curvature_per_m=np.array([0.1, 0.02, 0.005]),
            conditions=np.array([[0.85, 0.85], [-0.08, 0.08], [0.0, 0.0], [-200.0, 300.0]]),
        ),
        lift=Lift(True, history_steps=4, history_fields=DRIVABLE_HISTORY),
        encoder_onnx=b"not run here",
        selftest=LiftSample(
            x=rng.normal(size=(5, 6)), w=rng.normal(size=(5, 1)), history=rng.normal(size=(5, 4, 6))
        ),
        selftest_psi=rng.normal(size=(5, n)),
        training="{}",
        data_sha256="0" * 64,
    )


@pytest.fixture
def folder(bundle: Bundle, tmp_path: Path) -> Path:
    save_bundle(tmp_path, bundle, "# a card\n")
    return tmp_path


@pytest.fixture
def planar() -> Bundle:
    """A model of three states and two inputs at 10 ms, without curvature: not drivable."""
    rng = np.random.default_rng(2)
    n = 5
    return Bundle(
        name="planar",
        schema=PLANAR,
        A=0.9 * np.eye(n),
        B_uc=rng.normal(size=(n, 2)),
        B_uw=np.zeros((n, 0)),
        c=np.zeros(n),
        lift=Lift(history_steps=2, history_fields=("yaw_rate_radps", "force_n")),
        encoder_onnx=b"not run here",
        selftest=LiftSample(
            x=rng.normal(size=(4, 3)), w=np.zeros((4, 0)), history=rng.normal(size=(4, 2, 2))
        ),
        selftest_psi=rng.normal(size=(4, n)),
        training="{}",
        data_sha256="0" * 64,
    )

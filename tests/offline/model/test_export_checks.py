"""Growth of a bundle under inputs, the bundles that ship, and a bundle as a predictor."""

import json
from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
import onnx_bytes
import pytest
from made_models import (
    WITH_ALL,
    input_gains,
    join_gains,
    make_bundle,
    one_step,
    saturations,
)

import rt_controller
from offline.config import TrainingConfig
from offline.model.bundle_predictor import BundlePredictor
from offline.model.export_checks import (
    MOST_SIGNALS,
    box_stability,
    driven_matrices,
    limits_of,
    require_stable,
    signal_box,
    stability_of,
)
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import Schema, Signal
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Shape, roll_out


@pytest.fixture
def bent() -> Bundle:
    """Saturating gains of the inputs, of the curvature, and of the motion without inputs."""
    return make_bundle(WITH_ALL, rank=2, saturates=True, drift=1, latents=3)


RAIN, ONE = 1, 2
"""columns of [u; w; 1]"""
LEVEL = (Signal("level_m", "m"),)
TANK = Schema(LEVEL, (Signal("valve", "1"),), (Signal("rain_mps", "m/s"),), dt_s=0.1)


def tank(
    a: float = 0.9,
    gain: float | None = None,
    *,
    saturates: bool = False,
    drift: tuple[float, int] | None = None,
) -> Bundle:
    """One state, one input and one exogenous signal.

    `gain` is n s of the input, `drift` n s and the factor of a saturation.
    """
    one, nothing = np.ones((1, 1)), np.zeros((1, 1))
    linear = Bundle.linear(np.array([[a]]), one, nothing, schema=TANK)
    parts = [input_gains(gain * one[None], one[None], nothing, saturates)] if gain else []
    if drift:
        parts.append(saturations(drift[0] * one, one, np.zeros(1), np.array([drift[1]]), ONE))
    return replace(linear, gains=join_gains(*parts) if parts else None)


def box(valve: tuple[float, float] = (0.0, 0.0), rain: tuple[float, float] = (0.0, 0.0)) -> Array:
    return np.array([valve, rain]).T


@pytest.mark.parametrize("saturates", [False, True])
def test_the_radius_of_a_bilinear_model_is_a_plus_u_n_s_at_its_largest(saturates: bool) -> None:
    """0.9 + 3 * 0.1 for the highest input; |0.9 - 23 * 0.1| for the lowest of the second box."""
    model = tank(0.9, 0.1, saturates=saturates)
    assert box_stability(model, box((-2.0, 3.0))).unsaturated.radius == pytest.approx(1.2)
    assert box_stability(model, box((-23.0, 3.0))).unsaturated.radius == pytest.approx(1.4)


def test_points_inside_of_the_box_are_evaluated() -> None:
    """J = [[0, 1 - u], [u, 0]] has the radius sqrt(u (1 - u)): 0 at both bounds, 0.5 between."""
    pair = Schema((*LEVEL, Signal("flow_mps", "m/s")), (Signal("valve", "1"),), (), dt_s=0.1)
    linear = Bundle.linear(
        np.array([[0.0, 1.0], [0.0, 0.0]]), np.zeros((2, 1)), np.zeros((2, 0)), schema=pair
    )
    N, S = np.array([[-1.0, 0.0], [0.0, 1.0]]), np.array([[0.0, 1.0], [1.0, 0.0]])
    gains = input_gains(N[:, :, None], S[:, None, :], np.zeros((2, 1)), saturates=False)
    found = box_stability(replace(linear, gains=gains), np.array([[0.0], [1.0]]))
    assert found.unsaturated.radius == pytest.approx(0.5, abs=1e-3)
    assert found.at_states.radius == pytest.approx(0.5, abs=1e-3)
    assert found.saturated.radius == 0.0


@pytest.mark.parametrize("level", [1.0, 0.0])
def test_gains_are_also_as_saturated_as_in_the_self_test(level: float) -> None:
    """The drift, which is saturated at a level of 1 and not at 0, then does not damp the input.

    With all gains J is 0.9 + 0.3 - 0.2, without any 0.9, and with the first alone 0.9 + 0.3.
    """
    model = tank(0.9, 0.3, saturates=True, drift=(-0.2, RAIN))
    size = np.array([1e-3, 10.0])
    model = replace(
        model,
        gains=model.gains._replace(N=model.gains.N / size, S=model.gains.S * size[:, None]),
        selftest_psi=np.full((2, 1), level),
    )
    found = box_stability(model, box((1.0, 1.0), (1.0, 1.0)))
    assert found.unsaturated.radius == pytest.approx(1.0)
    assert found.saturated.radius == pytest.approx(0.9)
    assert found.at_states.radius == pytest.approx(1.2 if level == 1.0 else 1.0)


def test_a_product_with_an_exogenous_signal_acts_like_an_input() -> None:
    product = tank(0.9, drift=(0.5, RAIN))
    assert box_stability(product, box(rain=(-0.1, 0.4))).unsaturated.radius == pytest.approx(1.1)
    assert box_stability(product, box((-9.0, 9.0))).unsaturated.radius == pytest.approx(0.9)


def test_the_growth_of_a_chain_is_in_units_of_the_spread() -> None:
    """||A^80||_2 of two integrators, the second observable a hundred times as large."""
    pair = Schema((Signal("v", "m/s"), Signal("s", "m")), (), (), dt_s=1.0)
    chain = Bundle.linear(
        np.array([[1.0, 0.0], [1.0, 1.0]]), np.zeros((2, 0)), np.zeros((2, 0)), schema=pair
    )
    psi = np.array([[-1.0, -100.0], [1.0, 100.0]])
    found = box_stability(replace(chain, selftest_psi=psi), np.zeros((2, 0))).unsaturated
    assert found.growth == pytest.approx(np.linalg.norm([[1.0, 0.0], [0.8, 1.0]], 2))
    assert found.radius == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("a", "radius"), [(1e6, 1e6), (np.inf, np.inf), (np.nan, np.inf)])
def test_a_growth_beyond_all_numbers_is_infinite(a: float, radius: float) -> None:
    found = stability_of(np.full((1, 1, 1), a), tank())
    assert found == (radius, np.inf)


@pytest.mark.parametrize(("count", "is_found"), [(MOST_SIGNALS, True), (MOST_SIGNALS + 1, False)])
def test_all_corners_are_evaluated_up_to_ten_signals(count: int, is_found: bool) -> None:
    """The radius is largest where one half of the inputs is high and the other half low."""
    inputs = tuple(Signal(f"valve_{i}", "1") for i in range(count))
    many = Schema(LEVEL, inputs, (), dt_s=0.1)
    linear = Bundle.linear(np.array([[0.5]]), np.zeros((1, count)), np.zeros((1, 0)), schema=many)
    signs = np.where(np.arange(count) % 2 == 0, 0.1, -0.1)
    gains = input_gains(signs[None, None], np.ones((1, count, 1)), np.zeros((1, count)), False)
    found = box_stability(
        replace(linear, gains=gains), np.array([[-1.0], [1.0]]) * np.ones(count)
    ).unsaturated
    assert found.radius <= 0.5 + 0.1 * count
    assert (found.radius == pytest.approx(0.5 + 0.1 * count)) is is_found


@pytest.mark.parametrize("saturates", [False, True])
def test_j_is_the_derivative_of_one_step(bent: Bundle, saturates: bool) -> None:
    if not saturates:
        is_of_input = bent.gains.factor < 3
        shape = np.where(is_of_input, Shape.LINEAR, bent.gains.shape)
        bent = replace(bent, gains=bent.gains._replace(shape=shape))
    rng = np.random.default_rng(6)
    psi, u, w, step = 0.3 * rng.normal(size=9), rng.normal(size=3), rng.normal(size=1), 1e-5
    moved = psi + step * np.vstack([np.eye(9), -np.eye(9)])
    after = one_step(bent, moved, np.tile(u, (18, 1)), np.tile(w, (18, 1)))
    derivative = (after[:9] - after[9:]).T / (2.0 * step)
    slopes = 1.0 - np.tanh(psi @ bent.gains.S.T + bent.gains.s0) ** 2
    J = driven_matrices(bent, np.concatenate([u, w])[None], slopes[None])[0]
    np.testing.assert_allclose(J, derivative, rtol=1e-6, atol=1e-7)


def test_the_box_of_a_bundle_is_its_range_or_the_limits_of_the_car(bent: Bundle) -> None:
    known = np.array([[0.0, 0.0, -6.0, -0.02], [1.0, 150.0, 6.0, 0.02]])
    np.testing.assert_array_equal(signal_box(replace(bent, signal_range=known)), known)
    limits = [[*INPUT_LIMITS.lower, 0.0], [*INPUT_LIMITS.upper, 0.0]]
    np.testing.assert_array_equal(signal_box(replace(bent, signal_range=None)), limits)
    np.testing.assert_array_equal(signal_box(tank()), np.zeros((2, 2)))


FOLDERS = sorted(
    file.parent for file in Path(rt_controller.__file__).parent.glob("models/*/koopman.npz")
)
STEPS = 80
LARGEST = np.array([100.0, 30.0, 5.0, 2.5, 200.0, 2 * np.pi])
"""of each state over two seconds: v_x, v_y, yaw rate, progress in one period, e_y, e_psi; in SI"""


@pytest.fixture(params=FOLDERS, ids=lambda folder: folder.name)
def bundle(request):
    return load_bundle(request.param)


def test_radius_and_growth_over_the_box_of_signals_are_within_the_limits_of_an_export(bundle):
    stability = json.loads(bundle.training).get("stability")  # None: not a network
    limits = limits_of(TrainingConfig().model_copy(update={"stability": stability}))
    require_stable(box_stability(bundle, signal_box(bundle)), limits)


@pytest.mark.parametrize("steer_deg", [-180.0, 180.0])
@pytest.mark.parametrize("throttle", [0.0, INPUT_LIMITS.upper.throttle])
@pytest.mark.parametrize("brake_n", [0.0, INPUT_LIMITS.upper.brake_n])
def test_predictions_with_full_pedals_and_half_a_turn_of_the_wheel_are_bounded(
    bundle, throttle, brake_n, steer_deg
):
    """From every instant of the self-test, on a straight road."""
    count = len(bundle.selftest.x)
    u = np.tile((throttle, brake_n, radians(steer_deg)), (count, STEPS, 1))
    w = np.zeros((count, STEPS, 1))
    psi = BundlePredictor(bundle).lift(bundle.selftest._replace(w=w[:, 0]))
    states = roll_out(bundle, psi, u, w, len(LARGEST))
    assert (np.abs(states) < LARGEST).all()


@pytest.mark.parametrize(
    ("operator", "second", "complaint"),
    [
        ("Add", "far", "lifts states .32, 6., found that it cannot"),
        ("Concat", "x", "found .64, 6."),
    ],
)
def test_an_encoder_that_cannot_lift_a_batch_is_refused(operator, second, complaint):
    """It adds row 99 of the batch, or returns every row twice."""
    tensor, rows = onnx_bytes.value, onnx_bytes.constant("rows", np.array([99]))
    nodes = [
        onnx_bytes.node("Gather", ["x", "rows"], "far", axis=0),
        onnx_bytes.node(operator, ["x", second], "psi", axis=0 if operator == "Concat" else None),
    ]
    shape = ("batch", 6)
    encoder = onnx_bytes.model(
        nodes[operator == "Concat" :], [tensor("x", shape)], [tensor("psi", shape)], [rows]
    )
    lti = load_bundle(shipped_model("lti"))
    with pytest.raises(ArtifactError, match=complaint):
        BundlePredictor(replace(lti, encoder_onnx=encoder)).lift(lti.selftest)

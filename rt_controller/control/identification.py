"""What the model that drives above low speed knows: the gains of the pedals."""

import numpy as np

from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import (
    AT_REST,
    N_EXOGENOUS,
    N_INPUTS,
    N_STATES,
    NEUTRAL_INPUT,
    ControlInput,
    StateColumn,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.lift import Encoder, History
from rt_controller.control.low_speed import PedalGains
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import roll_out

STEP_S = 1.0
"""longer than the lags of engine and brakes, shorter than the change of speed matters"""
THROTTLE_STEP = 0.2
BRAKE_STEP_N = 30.0
THROTTLE_LIMITS_MPS2 = (6.0, 15.0)
"""a car in its lowest gear gains at least so much; linear models know the mean of all gears"""
BRAKE_LIMITS_MPS2_PER_N = (0.005, 0.5)


def identify_gains(bundle: Bundle, speed_mps: float) -> PedalGains:
    """Mean acceleration over a step of each pedal from `speed_mps`, per unit of the pedal.

    `speed_mps` is that at which the model takes over. The gains are kept within limits: one that is
    too large makes the law slow, one that is much too small makes it oscillate.

    Raises:
        ArtifactError: the model predicts no finite speeds.
    """
    encoder = Encoder(bundle)
    state = AT_REST._replace(vx_mps=speed_mps, ds_m=speed_mps * PERIOD_S)
    if encoder.history is not None:
        History(encoder.history).advance(state, NEUTRAL_INPUT)
    psi = np.tile(encoder.lift(state, 0.0), (3, 1))
    steps = round(STEP_S / PERIOD_S)
    inputs = np.zeros((3, steps, N_INPUTS))
    inputs[1] = ControlInput(THROTTLE_STEP, 0.0, 0.0)
    inputs[2] = ControlInput(0.0, BRAKE_STEP_N, 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        states = roll_out(bundle, psi, inputs, np.zeros((3, steps, N_EXOGENOUS)), N_STATES)
    ends_mps = states[:, -1, StateColumn.vx_mps]
    if not np.isfinite(ends_mps).all():
        raise ArtifactError(
            f"{bundle.name}: expected finite speeds {STEP_S:g} s after {speed_mps:g} m/s, with no "
            f"pedal, with throttle and with brake, found {ends_mps.tolist()} m/s. Train the model "
            f"again, or choose another one."
        )
    free, driven, braked = ends_mps.tolist()
    gains = PedalGains(
        throttle_mps2=(driven - free) / STEP_S / THROTTLE_STEP,
        brake_mps2_per_n=(free - braked) / STEP_S / BRAKE_STEP_N,
    )
    limits = THROTTLE_LIMITS_MPS2, BRAKE_LIMITS_MPS2_PER_N
    pairs = zip(gains, limits, strict=True)
    return PedalGains(*(min(max(gain, low), high) for gain, (low, high) in pairs))

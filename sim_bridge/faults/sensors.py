"""Noise of ordinary sensors, as faults of a scenario: every state, every period, by a seed."""

import numpy as np

from rt_controller.contract.signals import VehicleState
from sim_bridge.faults.fault import Fault

NOISE = VehicleState(
    vx_mps=0.03, vy_mps=0.03, yaw_rate_radps=0.002, ds_m=0.001, ey_m=0.015, epsi_rad=0.0015
)
"""standard deviation in each period: wheel speeds, a yaw rate sensor and a lane camera"""
OFFSET = VehicleState(
    vx_mps=0.0, vy_mps=0.02, yaw_rate_radps=0.0015, ds_m=0.0, ey_m=0.0, epsi_rad=0.0015
)
"""largest constant error of each signal, drawn for each drive"""
CURVATURE_NOISE_PER_M = 1e-4
_OFFSETS = tuple((name, most) for name, most in OFFSET._asdict().items() if most > 0.0)


def sensor_noise(rng: np.random.Generator) -> list[Fault]:
    """Noise of all states, and constant errors of some."""
    spread = {**NOISE._asdict(), "curvature_per_m": CURVATURE_NOISE_PER_M}
    noise = [
        Fault(kind="noise", signals=(name,), value=std, seed=int(rng.integers(1 << 30)))
        for name, std in spread.items()
    ]
    return noise + [offset(name, float(rng.uniform(-most, most))) for name, most in _OFFSETS]


def offset(signal: str, value: float, start_s: float = 0.0) -> Fault:
    """A constant error of one signal."""
    return Fault(kind="bias", signals=(signal,), value=value, start_s=start_s)

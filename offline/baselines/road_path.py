"""The path states of a car on its road, from its motion.

s' = (v_x cos e_psi - v_y sin e_psi) / (1 - kappa e_y), e_y' = v_x sin e_psi + v_y cos e_psi,
e_psi' = yaw rate - kappa s'. The path states act on each other only through the curvature, which
is small, so a few Picard iterations over the whole horizon give the same path as integration step
by step, in a tenth of the time.

Paper: eq. (2), "set of states and inputs".
"""

from types import ModuleType
from typing import Any, NamedTuple

from rt_controller.contract.signals import MOTION, VEHICLE, Schema, StateColumn

ITERATIONS = 5
"""each divides the error by 20, on a road of 100 m radius at 30 m/s"""


class Learned(NamedTuple):
    """What a model has to learn if the path states follow from the motion."""

    states: int
    """number of the learned states, which come first"""
    exogenous: tuple[int, ...]
    """columns of W that act on them"""
    curvature: int | None
    """column of W that the path is computed with; None: no path, all states are learned"""


def split_path(schema: Schema) -> Learned:
    """Motion and path of a car on a road; all other data have no path to compute."""
    columns = range(len(schema.exogenous))
    (name,) = VEHICLE.exogenous_names
    if schema.state_names != VEHICLE.state_names or name not in schema.exogenous_names:
        return Learned(len(schema.states), tuple(columns), None)
    curvature = schema.exogenous_names.index(name)
    return Learned(MOTION.stop, tuple(i for i in columns if i != curvature), curvature)


def path_states(numerics: ModuleType, motion: Any, x0: Any, kappa: Any, dt_s: float) -> Any:
    """Progress per step, e_y and e_psi (batch, K, 3) after each of K steps.

    motion (batch, K+1, 3) are v_x, v_y and yaw rate at the ends of the steps, linear in between;
    x0 (batch, 6) is the first state and kappa (batch, K) the curvature of each step. All are
    arrays or tensors of the library `numerics`: numpy or torch.
    """
    vx = motion[..., StateColumn.vx_mps]
    vy = motion[..., StateColumn.vy_mps]
    yaw_rate = motion[..., StateColumn.yaw_rate_radps]
    ey0, epsi0 = x0[:, [StateColumn.ey_m]], x0[:, [StateColumn.epsi_rad]]
    zero = numerics.zeros_like(ey0)

    def integral(rate: Any, factor: Any = 1.0) -> Any:
        """Integral (batch, K+1) of a rate (batch, K+1), each step of it times `factor`."""
        steps = 0.5 * dt_s * (rate[:, :-1] + rate[:, 1:]) * factor
        return numerics.concatenate([zero, numerics.cumsum(steps, 1)], 1)

    yaw = epsi0 + integral(yaw_rate)
    ey, epsi = ey0 + 0.0 * vx, yaw - integral(vx, kappa)
    kappa_at_ends = numerics.concatenate([kappa, kappa[:, -1:]], 1)
    progress_mps = vx
    for _ in range(ITERATIONS):
        sine, cosine = numerics.sin(epsi), numerics.cos(epsi)
        progress_mps = (vx * cosine - vy * sine) / (1.0 - kappa_at_ends * ey)
        ey = ey0 + integral(vx * sine + vy * cosine)
        epsi = yaw - integral(progress_mps, kappa)
    ds = 0.5 * dt_s * (progress_mps[:, :-1] + progress_mps[:, 1:])
    return numerics.stack([ds, ey[:, 1:], epsi[:, 1:]], -1)

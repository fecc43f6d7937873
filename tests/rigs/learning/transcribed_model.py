"""One step of the network written out, gain by gain."""

import torch
from torch import Tensor

from offline.model.network import MdkNet
from rt_controller.model.dynamics import Shape
from rt_controller.model.follow import Follow


def step(model: MdkNet, psi: Tensor, followed: Tensor, u: Tensor, w: Tensor) -> Tensor:
    """psi_(k+1) (n,): A psi + B [u; w] + sum_r N_r g_r(S_r psi') f_r.

    psi' is `followed` (n,); u (m,), w (p,).
    """
    A, B = model.operator()
    S, N = model.gains()
    after = A @ psi + B @ torch.cat([u, w])
    signals = [*u, *w, 1.0]
    columns = [column for term in model.terms for column in term.factors]
    shapes = [term.shape for term in model.terms for _ in term.factors]
    for r, (column, shape) in enumerate(zip(columns, shapes, strict=True)):
        a = S[r] @ followed
        t = {Shape.LINEAR: a, Shape.TANH: a.tanh(), Shape.SATURATION: a.tanh() - a}[shape]
        after = after + N[:, r] * t * signals[column]
    return after


def roll_out(model: MdkNet, psi0: Tensor, u: Tensor, w: Tensor) -> Tensor:
    """Lifted states (K, n) after 1..K steps from psi0 (n,), with u (K, m) and w (K, p)."""
    A, B = model.operator()
    psi = followed = psi0
    states = []
    for k in range(len(u)):
        following = step(model, psi, followed, u[k], w[k])
        psi = following if model.path is None else with_path(model, psi, following, w[k, 0])
        states.append(psi)
        if model.follows is Follow.PREDICTION:
            followed = psi
        elif model.follows is Follow.FREE_RESPONSE:
            followed = A @ followed + B[:, model.sizes.inputs :] @ w[k]
    return torch.stack(states)


def with_path(model: MdkNet, before: Tensor, following: Tensor, curvature: Tensor) -> Tensor:
    """The lifted state (n,) after a step, with progress, e_y and e_psi of a car on a circle.

    The car is moved on a plane whose x axis touches the road, and projected onto the circle.
    """
    S, s0 = model.path.movement()
    ahead, left, turned = S @ before + s0
    _, ey, epsi = before[3:6]
    middle = epsi + 0.5 * turned
    x = ahead * middle.cos() - left * middle.sin()
    y = ey + ahead * middle.sin() + left * middle.cos()
    radius = 1.0 / curvature
    turn = torch.atan2(curvature * x, 1.0 - curvature * y)
    distance = torch.sqrt(x**2 + (radius - y) ** 2)
    path = [turn * radius, radius - radius.sign() * distance, epsi + turned - turn]
    return torch.cat([following[:3], torch.stack(path), following[6:]])

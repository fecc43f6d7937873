"""One made bundle of every class of model, and a plan to linearise it along."""

import numpy as np
from made_models import make_bundle

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import N_INPUTS
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import Lift

RANGE = np.subtract(INPUT_LIMITS.upper, INPUT_LIMITS.lower)
DISTURBANCE = np.array([0.01, -0.005, 0.002, 0.0, 0.003, -0.001])
VARIANTS = {
    "linear": {},
    "bilinear of rank 1": {"rank": 1},
    "bilinear": {"rank": 4},
    "saturating": {"rank": 4, "saturates": True},
    "drift": {"drift": 2},
    "bilinear with drift": {"rank": 1, "drift": 2},
    "saturating with drift": {"rank": 3, "saturates": True, "drift": 2},
    "exact path": {"rank": 3, "saturates": True, "drift": 2, "has_exact_path": True},
}


def made(variant: str, lift: Lift | None = None) -> Bundle:
    return make_bundle(lift or Lift(), bend=0.5, **VARIANTS[variant])


def knots_of(count: int) -> Array:
    """(K, 3), a plan whose inputs change."""
    return RANGE * (0.1 + 0.2 * np.random.default_rng(5).normal(size=(count, N_INPUTS)))

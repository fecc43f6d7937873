"""What the paper prints, and the form in which the results here stand beside it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import prod
from typing import Any

from rt_controller.report.page import Plot

Figures = dict[str, Any]
"""numbers by name, with the unit in the name"""

HYPERPARAMETERS = {
    "steps": 60_000,
    "batch": 128,
    "latents": 60,
    "hidden": (32, 64, 128, 128, 64),
    "learning_rate": 1e-3,
    "patience": 3,
    "forgetting": 0.9,
    "weight_single_step": 1.0,
    "weight_multi_step": 0.5,
    "weight_stability": 1.6,
    "weight_regularisation": 1e-4,
    "decay_encoder": 0.9,
    "decay_operator": 0.5,
}
"""of Table I, by the names of the settings here"""

MDK_NET, LTI = "MDK-Net", "LTI model"
STATES = ("vx", "vy", "yaw_rate", "ds", "ey", "epsi")
MSE = {
    MDK_NET: (2.908, 0.020, 0.445, 0.00045, 2.504, 0.761),
    LTI: (6937.684, 0.548, 3.139, 0.2305, 39.303, 11.242),
}
"""of Table II, by `STATES`, in squared units"""

COMPUTATION_S = {MDK_NET: 7.4, LTI: 3.2}
"""of 400 steps, from the text of section IV-A"""


def mse_ratios() -> dict[str, float]:
    """Printed MSE of the LTI model over that of MDK-Net by state, and their geometric mean.

    Of three digits, as most of the printed errors.
    """
    ratios = [lti / mdk for lti, mdk in zip(MSE[LTI], MSE[MDK_NET], strict=True)]
    mean = prod(ratios) ** (1.0 / len(ratios))
    exact = {**dict(zip(STATES, ratios, strict=True)), "geometric_mean": mean}
    return {name: float(f"{ratio:.3g}") for name, ratio in exact.items()}


def beside(here: Mapping[str, Any], paper: Mapping[str, Any]) -> Figures:
    """Each result with the printed number of the same name."""
    return {name: {"here": value, "paper": paper[name]} for name, value in here.items()}


@dataclass(frozen=True, slots=True)
class Element:
    """A table, figure or algorithm of the paper, and what was found here."""

    place: str
    """its number in the paper"""
    shows: str
    """what it shows, and what differs here"""
    summary: Figures
    """its main numbers: {here, paper} by name, without paper if it prints none"""
    tables: Mapping[str, Figures]
    """by name of the block in the documents: rows by name, each with the same columns"""
    plots: Mapping[str, Plot] = field(default_factory=dict)
    """by the name of the file"""

    def overview(self) -> Figures:
        """A row for each main number."""
        return {
            f"{self.place}: {name}": {
                "paper, CarSim": values.get("paper"),
                "here, another car": values["here"],
            }
            for name, values in self.summary.items()
        }

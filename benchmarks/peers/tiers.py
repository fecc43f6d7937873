"""The quadratic programs of this controller, from the paper's to the fullest."""

from rt_controller.control.corridor import Corridor
from rt_controller.control.qp import PAPER, WITH_SLEW, Features

TIERS = {
    "box": PAPER,
    "slew": WITH_SLEW,
    "corridor": Features(corridor=Corridor(half_width_m=0.1, beyond_m=0.05)),
}
"""60 bounded variables; with 60 rows; with 80 rows and 20 more variables"""

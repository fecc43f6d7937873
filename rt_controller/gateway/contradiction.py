"""A relation between signals of a car, and what contradicts it."""

from math import inf, log
from typing import NamedTuple

from rt_controller.gateway.window_comparison import Agreement, Comparison
from rt_controller.mapping.unit_mistakes import find_mistake

LARGEST_FACTOR = 1.5
"""between a kinematic quantity and its measurement; mph for km/h is 1.6"""
SPEED, LATERAL, YAW_RATE = "states.vx_mps", "states.vy_mps", "states.yaw_rate_radps"
OFFSET, HEADING, CURVATURE = "states.ey_m", "states.epsi_rad", "exogenous.curvature_per_m"
WANTED = "reference.v_mps"
WHEELS = ("inputs.steer_rad", "commands.steer_rad")
NOT_COMPARED = {
    Agreement.TOO_LITTLE_MOTION: "too little motion",
    Agreement.UNCLEAR: "no clear relation: noise, wind, sliding, or commands that are not followed",
}
ANGLES = (HEADING, *WHEELS)


class Relation(NamedTuple):
    """A signal, what is expected of it, and what was found."""

    signal: str
    expected: str
    result: Comparison
    largest_factor: float = LARGEST_FACTOR

    @property
    def is_contradiction(self) -> bool:
        """True if the sign or the factor is wrong."""
        agreement = self.result.agreement
        if agreement is Agreement.SAME_SIGN:
            return abs(log(self.times)) > log(self.largest_factor)
        return agreement not in NOT_COMPARED

    @property
    def times(self) -> float:
        """Size of the factor; tiny instead of 0."""
        return max(abs(self.result.factor), 1e-9)

    def finding(self) -> str:
        """What was found of a contradiction."""
        agreement, factor = self.result
        if agreement is Agreement.NONE:
            return "changes without a cause" if factor == inf else "no relation to it"
        times = abs(factor)
        is_far = abs(log(self.times)) > log(self.largest_factor)
        mistake = find_mistake(times)
        if mistake and self.signal in ANGLES and "degrees" not in mistake:
            mistake = None
        words = f"{times:.3g} times it ({mistake or 'a wrong factor'}?)"
        if agreement is Agreement.OPPOSITE_SIGN:
            return "the opposite sign" + (f", {words}" if is_far else "")
        return words


def sentence(each: Relation) -> str:
    """The contradiction of a relation: expected and found."""
    return f"{each.signal}: expected {each.expected}, found {each.finding()}"


def remedy(each: Relation, is_geometry_known: bool) -> str:
    """What to correct, for the contradiction of a relation."""
    what = "`sign`" if each.finding() == "the opposite sign" else "column, unit, factor or sign"
    more = ""
    if each.signal in WHEELS and not is_geometry_known:
        more = ", or write wheelbase_m and steering_ratio in [car]"
    return f"Correct {what} of {each.signal} or of a signal that it is compared with{more}"

"""A relation between signals of a car, and the signal that explains why it does not hold.

The signal that alone explains all contradictions, and is in no relation that holds, is named.
"""

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
    others: tuple[str, ...]
    """the signals that the expectation is made of"""
    result: Comparison
    largest_factor: float = LARGEST_FACTOR
    loose: tuple[str, ...] = ()
    """signals that the expectation hardly depends on"""

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


def remedy(each: Relation, suspects: tuple[str, ...], is_geometry_known: bool) -> str:
    """What to correct, for the contradiction of a relation."""
    what = "`sign`" if each.finding() == "the opposite sign" else "column, unit, factor or sign"
    more = ""
    if each.signal in WHEELS and each.signal in suspects:
        more = "; all angles are positive to the left"
        if each.result.agreement is Agreement.SAME_SIGN and not is_geometry_known:
            more = ", or write wheelbase_m and steering_ratio in [car]"
    return f"Correct {what} of {' or '.join(suspects)}{more}"


def suspects_of(each: Relation, found: list[Relation]) -> tuple[str, ...]:
    """The signals that explain all contradictions alone; else those of this one."""
    own, loose = (each.signal, *each.others), each.loose
    is_sign = each.result.agreement is Agreement.OPPOSITE_SIGN
    if is_sign:
        own, loose = tuple(name for name in own if name != SPEED), ()
    wrong = [one for one in found if one.is_contradiction]
    right = [
        one
        for one in found
        if not one.is_contradiction and one.result.agreement is Agreement.SAME_SIGN
    ]
    cleared = [
        name
        for name in (*own, *loose)
        if any(
            name in (one.signal, *one.others)
            and (is_sign or one.largest_factor < max(each.times, 1.0 / each.times))
            for one in right
        )
    ]
    left = tuple(name for name in own if name not in cleared) or own
    alone = tuple(
        name
        for name in dict.fromkeys((*left, *loose))
        if name not in cleared
        and all(name in (one.signal, *one.others, *one.loose) for one in wrong)
    )
    return alone or left

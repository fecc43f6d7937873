"""Does a scenario need more grip than the friction that replaces its own? A note beforehand."""

from sim_bridge.scenario import Scenario
from sim_bridge.scenario.checks import problems


def grip_note(scenario: Scenario) -> str | None:
    """A sentence if the path cannot be driven with the friction of --friction; else None.

    With the friction in its file such a scenario is refused; --friction is there to try it.

    `scenario` has the friction that is driven.
    """
    found = problems(scenario)
    if not found:
        return None
    return f"scenario {scenario.name!r} with this --friction: {found[0]} It is driven all the same."

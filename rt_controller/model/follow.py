"""The lifted state that the gains of a model follow.

Imports no numpy, so that command lines load quickly.
"""

from enum import StrEnum


class Follow(StrEnum):
    """From which lifted state the gains are computed in each step of a prediction."""

    PREDICTION = "prediction"
    """that of the step itself, as in a bilinear model. The controller uses the states that its last
    plan predicted"""
    FREE_RESPONSE = "free-response"
    """what the first lifted state becomes without inputs"""
    START = "start"
    """the first lifted state, in all steps"""

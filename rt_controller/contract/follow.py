"""What a bilinear model is read from, as a word that people may choose by; needs no numbers."""

from enum import StrEnum


class Follow(StrEnum):
    """What the input matrix of a bilinear model is read from, over a prediction."""

    PREDICTION = "prediction"
    """the lifted state of each step: the bilinear model itself. A controller plans along the
    prediction of its last plan"""
    FREE_RESPONSE = "free-response"
    """what the first lifted state becomes without inputs"""
    START = "start"
    """the first lifted state"""

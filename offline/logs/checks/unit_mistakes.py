"""Units that are often confused, found from the ratio of two records of one quantity."""

from math import log, pi

FACTOR_TOLERANCE = 0.12
"""relative difference between a ratio and a known factor that still counts as that factor"""

UNIT_MISTAKES = {
    3.6: "km/h taken for m/s",
    180.0 / pi: "degrees taken for radians",
    9.80665: "g taken for m/s^2",
    100.0: "% taken for a ratio",
    1000.0: "a factor of a thousand",
}
"""units that are often confused, by the ratio of their numbers"""


def find_mistake(ratio: float) -> str | None:
    """The confusion of units that changes a number by this ratio, or its inverse; else None."""
    for factor, words in UNIT_MISTAKES.items() if ratio > 0.0 else ():
        if abs(abs(log(ratio)) - log(factor)) < log(1.0 + FACTOR_TOLERANCE):
            return words
    return None

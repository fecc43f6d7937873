"""Something in the logs that the user should look at before training."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Issue:
    """One remark of a check, with what to do about it."""

    check: str
    subject: str
    """signal or file"""
    message: str

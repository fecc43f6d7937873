"""Something about the logs that a person should look at before training on them."""

from typing import NamedTuple


class Finding(NamedTuple):
    """One remark, with what to do about it."""

    about: str
    """the check that made it"""
    subject: str
    """signal, or file"""
    says: str

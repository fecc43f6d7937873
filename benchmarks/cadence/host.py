"""What the machine under the machine took away meanwhile."""

from pathlib import Path

TICKS_PER_S = 100.0
"""USER_HZ of Linux"""


def stolen_s() -> float:
    """Time that the host ran others on this machine's cores, since it started; all cores."""
    fields = Path("/proc/stat").read_text().splitlines()[0].split()
    return float(fields[8]) / TICKS_PER_S

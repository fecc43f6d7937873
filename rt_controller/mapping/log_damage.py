"""Where a CAN log that its reader refuses is damaged, in words of its format.

The readers of python-can raise errors of many types whose texts describe their own code.
"""

import re
from pathlib import Path

_CANDUMP_LINE = re.compile(
    r"\(\d+\.\d+\)\s+\S+\s+"
    r"[0-9A-F]{1,8}#"
    r"(#[0-9A-F]([0-9A-F]{2})*|R\d{0,2}|([0-9A-F]{2})*)"
    r"(\s+[RT])?",  # python-can adds the direction
    re.ASCII | re.IGNORECASE,
)


def is_candump_line(line: str) -> bool:
    """True if this is a whole line as `candump -L` writes it."""
    return _CANDUMP_LINE.fullmatch(line.strip()) is not None


def explain_candump_line(path: Path, number: int, line: str) -> str:
    """The place, and what was expected and found there, of a line in another form."""
    text = line.strip()
    shown = text if len(text) <= 80 else f"{text[:80]}…"
    return (
        f"{path}, line {number}: expected (seconds) channel ID#DATA with ID and DATA in "
        f"hexadecimal digits, found {shown!r}"
    )


def explain_damage(path: Path, n_frames: int) -> str:
    """The place, and what was expected and found there, of a log refused after `n_frames`."""
    if path.suffix.lower() == ".log":
        with path.open(encoding="utf-8", errors="replace") as lines:
            for number, line in enumerate(lines, start=1):
                if line.strip() and not is_candump_line(line):
                    return explain_candump_line(path, number, line)
    if n_frames == 0:
        return (
            f"{path}: expected a CAN log in the format of its suffix, found a file without a "
            f"readable first frame: truncated, damaged or in another format"
        )
    return (
        f"{path}, frame {n_frames + 1}: expected a frame in the format {path.suffix}, found "
        f"truncated or damaged bytes after {n_frames} whole frames"
    )

"""Progress on stderr: live on a terminal, a few lines in a log."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from threading import Thread
from typing import NamedTuple

from rich.console import Console
from rich.control import Control
from rich.segment import ControlType
from rich.text import Text

LIVE_INTERVAL_S = 0.5
LOG_INTERVAL_S = 10.0
SETTLING = "settling the car"
_EMPTY_LINE = Control(ControlType.CARRIAGE_RETURN, (ControlType.ERASE_IN_LINE, 2))


class Line(NamedTuple):
    """What happens at present, in two parts, and a note."""

    state: str
    """such as waiting, or the mode"""
    figures: str = ""
    note: str = ""
    """is shown in a line of its own, each time that it is given"""
    warning: str = ""
    """the same for what has gone wrong; a quiet command shows it too"""


def announce(text: str, is_quiet: bool = False) -> AbstractContextManager[object]:
    """Show what the commands in this context do: while they do it, or as a line in a log."""
    stderr = Console(stderr=True, quiet=is_quiet, emoji=False)
    if is_live(stderr):
        return stderr.status(text)
    show(text, is_quiet)
    return nullcontext()


def is_live(console: Console) -> bool:
    """True if what it shows can be replaced: not in a log, also with FORCE_COLOR, or if dumb."""
    return console.file.isatty() and console.is_interactive


def show(text: str, is_quiet: bool = False) -> None:
    """Print a text on stderr, never wrapped and never read as markup."""
    stderr = Console(stderr=True, quiet=is_quiet, emoji=False)
    stderr.print(text, highlight=False, markup=False, soft_wrap=True)


def _replace(text: str, is_quiet: bool, is_last: bool) -> None:
    """Show a text in the present line of the terminal, which the next call replaces if not last.

    It has one line at most, since only one is replaced; what the terminal has echoed there, such as
    ^C, is erased too.
    """
    stderr = Console(stderr=True, quiet=is_quiet, emoji=False)
    stderr.control(_EMPTY_LINE)
    # A text that fills the last column would move the cursor to the next line.
    line = Text(text, no_wrap=True, overflow="ellipsis")
    line.truncate(stderr.width - 1, overflow="ellipsis")
    stderr.print(line, end="\n" if is_last else "\r")


def watch(thread: Thread, line: Callable[[], Line], is_quiet: bool) -> None:
    """Show what a started thread does; return when it has ended.

    `line` is shown every half a second on a terminal; in a log when its first part has changed, at
    the end, and every ten seconds if it has figures.
    """
    is_terminal = is_live(Console(stderr=True))
    shown, next_s, is_over = Line("", ""), 0.0, False
    while not is_over:
        thread.join(LIVE_INTERVAL_S)
        is_over = not thread.is_alive()
        now = line()
        for text, is_hidden in ((now.warning, False), (now.note, is_quiet)):
            if text and is_terminal:
                Console(stderr=True, quiet=is_hidden).control(_EMPTY_LINE)
            if text:
                show(text, is_hidden)
        now = now._replace(note="", warning="")
        is_due = is_over or (now.figures and time.monotonic() >= next_s)
        text = "  ".join(filter(None, now))
        if is_terminal:
            _replace(text, is_quiet, is_last=is_over)
        elif now.state != shown.state or (is_due and now != shown):
            show(text, is_quiet)
            shown, next_s = now, time.monotonic() + LOG_INTERVAL_S

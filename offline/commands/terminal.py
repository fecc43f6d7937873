"""Where offline commands print: summary on stdout, progress on stderr; and how they are stopped."""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from shlex import quote
from types import FrameType
from typing import Any

from rich.console import Console

from rt_controller.terminal.progress import is_live

STDOUT = Console(emoji=False)
STDERR = Console(stderr=True, emoji=False)
LINE_EVERY_S = 5.0
"""between two lines of progress that are not on a terminal"""


def print_plain(text: str) -> None:
    """Print a text that may contain paths: no markup, no colours, lines are not broken."""
    STDOUT.print(text, soft_wrap=True, markup=False, highlight=False)


def quoted(word: object) -> str:
    """A path or name as one word of a command that is printed for the shell."""
    return quote(str(word))


@contextmanager
def progress_bar(title: str, total: int, done: int = 0) -> Iterator[Callable[[int, str], None]]:
    """A bar with the time left; call what it yields with the number done and text to show below.

    In a pipe or a file it is a line every few seconds.
    """
    if not is_live(STDERR):
        yield _plain_progress(title, total, done)
        return
    from rich import progress
    from rich.console import Group
    from rich.live import Live
    from rich.text import Text

    bar = progress.Progress(
        "{task.description}",
        progress.BarColumn(bar_width=30),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        "left",
        progress.TimeRemainingColumn(),
    )
    task = bar.add_task(title, total=total, completed=done)
    below = Text()
    with Live(Group(bar, below), console=STDERR, refresh_per_second=4):

        def show(completed: int, text: str) -> None:
            bar.update(task, completed=completed)
            below.plain = text

        yield show


def _plain_progress(title: str, total: int, first: int) -> Callable[[int, str], None]:
    begun_s = printed_s = time.monotonic()

    def show(completed: int, text: str) -> None:
        nonlocal printed_s
        now_s = time.monotonic()
        if now_s - printed_s < LINE_EVERY_S and completed < total:
            return
        printed_s = now_s
        left_s = (now_s - begun_s) / max(completed - first, 1) * (total - completed)
        print(f"{title}: {completed} of {total}, {left_s:.0f} s left", file=sys.stderr, flush=True)
        for line in filter(None, text.splitlines()):
            print(f"  {line}", file=sys.stderr, flush=True)

    return show


@contextmanager
def stop_on_signals(on_request: Callable[[], None] = lambda: None) -> Iterator[Callable[[], bool]]:
    """Yields a function that is true once SIGINT (Ctrl-C), SIGTERM or SIGHUP was received.

    `on_request` is called when the first signal is received; a second one has its usual effect. A
    hang-up that the program was started to ignore (nohup) stays ignored.
    """
    requested = False
    previous: dict[signal.Signals, Any] = {}

    def restore() -> None:
        for number, handler in previous.items():
            signal.signal(number, handler)

    def request(number: int, frame: FrameType | None) -> None:
        nonlocal requested
        requested = True
        restore()
        on_request()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number is not signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            previous[number] = signal.signal(number, request)
    try:
        yield lambda: requested
    finally:
        restore()

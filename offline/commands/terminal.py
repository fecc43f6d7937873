"""Where the offline commands print: the summary on stdout, progress and errors on stderr."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

STDOUT = Console()
STDERR = Console(stderr=True)
LINE_EVERY_S = 5.0
"""between two lines of progress that are not on a terminal"""


@contextmanager
def progress_bar(title: str, total: int, done: int = 0) -> Iterator[Callable[[int, str], None]]:
    """A bar with the time left; call what it yields with the number done and text to show below.

    In a pipe or a file it is a line every few seconds.
    """
    if not STDERR.is_terminal:
        yield _plain_progress(title, total, done)
        return
    from rich.console import Group
    from rich.live import Live
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
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

"""Where the offline commands print: the summary on stdout, progress and errors on stderr."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

from offline.config import TrainingConfig, assumed_fields

STDOUT = Console()
STDERR = Console(stderr=True)


def print_assumed(stored: TrainingConfig) -> None:
    """Say which settings a stored configuration lacks, because they are newer than it."""
    assumed = ", ".join(f"{name} = {value}" for name, value in assumed_fields(stored).items())
    if assumed:
        STDERR.print(
            f"The configuration of this run is of an older version; the defaults are assumed for "
            f"what it does not say: {assumed}.",
            soft_wrap=True,
        )


@contextmanager
def progress_bar(title: str, total: int, done: int = 0) -> Iterator[Callable[[int, str], None]]:
    """A bar with the time left; call what it yields with the number done and text to show below."""
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
    if not STDERR.is_terminal:
        STDERR.line()  # rich ends the last line only on a terminal

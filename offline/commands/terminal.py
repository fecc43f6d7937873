"""Where the offline commands print: the summary on stdout, progress and errors on stderr."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

STDOUT = Console()
STDERR = Console(stderr=True)


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

"""What the offline commands show: bars, and where to print."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console, Group
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

CONSOLE = Console()
ERRORS = Console(stderr=True)


@contextmanager
def progress_bar(title: str, total: int, done: int = 0) -> Iterator[Callable[[int, str], None]]:
    """A bar with time left; the yielded function sets how many are done, and lines below it."""
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    task = bar.add_task(title, total=total, completed=done)
    remark = Text()
    with Live(Group(bar, remark), console=CONSOLE, refresh_per_second=4):

        def show(completed: int, lines: str) -> None:
            bar.update(task, completed=completed)
            remark.plain = lines

        yield show

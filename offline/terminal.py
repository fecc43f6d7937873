"""What the offline commands show: bars, tables, and one way to end with an error."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

CONSOLE = Console()
ERRORS = Console(stderr=True)


@contextmanager
def progress_bar(title: str, total: int, done: int = 0) -> Iterator[Callable[[int, str], None]]:
    """A bar with time left; the yielded function sets how many are done, and a remark."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[remark]}"),
    )
    with Progress(*columns, console=CONSOLE, refresh_per_second=4) as progress:
        task = progress.add_task(title, total=total, completed=done, remark="")

        def show(completed: int, remark: str) -> None:
            progress.update(task, completed=completed, remark=remark)

        yield show


def error_table(title: str, rows: Mapping[str, tuple[float, ...]], heads: tuple[str, ...]) -> Table:
    """One row a model, one column a state."""
    table = Table(title=title, title_justify="left")
    table.add_column("model", no_wrap=True)
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    for name, numbers in rows.items():
        table.add_row(name, *(f"{number:.4g}" for number in numbers))
    return table

"""One table type for all reports, and its forms: terminal, Markdown; the page renders it as HTML.

A program builds a `Table` of finished texts and passes it to `print_table`, `to_markdown` or
`rt_controller.report.page.render_page`. Figures for `--json` come from the results themselves,
not from the rounded texts of a table.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Literal, NamedTuple

import numpy as np
from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.segment import Segment, Segments
from rich.table import Table as RichTable
from rich.text import Text

NO_VALUE = "–"
PLAIN_BELOW = 1e7
"""larger numbers are written with a power of ten"""

Status = Literal["", "good", "bad", "faint"]
_COLORS: dict[Status, str] = {"": "", "good": "green", "bad": "bold red", "faint": "dim"}


class Column(NamedTuple):
    """Head of a column."""

    title: str
    unit: str = ""
    is_text: bool = False
    """True: aligned left, long cells are wrapped. False: aligned right, never wrapped"""
    width: Literal["", "short", "long"] = ""
    """of a text on the page: never wrapped, or sentences in a wide column"""


class Cell(NamedTuple):
    """Text of one cell."""

    text: str
    detail: str = ""
    """second line in smaller type, for instance the confidence interval"""
    status: Status = ""
    """colour of the text"""


class Fact(NamedTuple):
    """A name and its value, both as text."""

    name: str
    """with the unit where there is one"""
    value: str


Row = tuple[Cell | str, ...]


@dataclass(frozen=True, slots=True)
class Table:
    """A table of finished texts.

    A row has one cell for each column; a row with a single cell is a heading of the rows below it.
    """

    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    footnotes: tuple[str, ...] = ()

    @property
    def has_heads(self) -> bool:
        """True if a column has a title."""
        return any(column.title for column in self.columns)


def facts_table(facts: Iterable[Fact], title: str = "") -> Table:
    """Two columns of text without heads: name and value."""
    columns = (Column("", is_text=True), Column("", is_text=True))
    return Table(title, columns, tuple(tuple(fact) for fact in facts))


def format_number(number: float, digits: int = 4) -> str:
    """The number with so many significant digits; "–" for NaN.

    Below 1e7 it has no power of ten.
    """
    if np.isnan(number):
        return NO_VALUE
    text = f"{number + 0.0:.{digits}g}"  # not "-0"
    return f"{float(text):.0f}" if "e+" in text and abs(number) < PLAIN_BELOW else text


def printed_unit(unit: str) -> str:
    """The unit with raised exponents: m/s^2 is m/s²."""
    return unit.replace("^2", "²").replace("^3", "³")


def print_table(table: Table, console: Console) -> None:
    """Print the table. Of one that is too wide, the texts at the end of a row stand below its name.

    If it still does not fit, it is printed in several parts, which all have the first column. Texts
    are wrapped, but no number is cut: a single column may be wider than the console.
    """
    if _least_width(table, console) > console.width:
        table = _stacked(table)
    for part in _parts(table, console):
        shown = to_rich(part)
        options = console.options.update(width=max(console.width, _least_width(part, console)))
        lines = Segment.split_lines(console.render(shown, options))
        segments = [each for line in lines for each in (*_without_padding(line), Segment.line())]
        console.print(Segments(segments), crop=False, end="")


def print_text(text: str, console: Console) -> None:
    """Print sentences literally: a terminal wraps them at spaces, a pipe or a file does not."""
    is_piped = not console.is_terminal
    console.print(text, highlight=False, markup=False, emoji=False, soft_wrap=is_piped)


def _without_padding(line: list[Segment]) -> list[Segment]:
    """The line without the blanks at its end."""
    while line and not line[-1].text.strip():
        line.pop()
    return [*line[:-1], *(each._replace(text=each.text.rstrip()) for each in line[-1:])]


def _stacked(table: Table) -> Table:
    """The table with the text columns after its last number below the first cell of each row."""
    numbers = [i for i, column in enumerate(table.columns) if not column.is_text]
    kept = max(numbers, default=len(table.columns) - 1) + 1
    first, *others = table.columns[:kept]
    below = [column.title for column in table.columns[kept:] if column.title]
    head = first._replace(title="\n".join(filter(None, (first.title, "; ".join(below)))))
    rows = []
    for row in table.rows:
        name, texts = _as_cell(row[0]), [_lines(cell).plain for cell in row[kept:]]
        detail = "; ".join(filter(None, (name.detail, *texts)))
        rows.append((name._replace(detail=detail), *row[1:kept]))
    return replace(table, columns=(head, *others), rows=tuple(rows))


def _parts(table: Table, console: Console) -> Iterator[Table]:
    """The table with as many columns as fit, then the others; footnotes below the last part."""
    title, chosen = table.title, [0]
    for i in range(1, len(table.columns)):
        is_too_wide = _least_width(_select(table, [*chosen, i]), console) > console.width
        if is_too_wide and len(chosen) > 1:
            yield replace(_select(table, chosen), title=title, footnotes=())
            title, chosen = "", [0]
        chosen.append(i)
    yield replace(_select(table, chosen), title=title)


def _select(table: Table, chosen: Sequence[int]) -> Table:
    """The table with these columns only; rows of a single cell are kept."""
    rows = [
        tuple(row[i] for i in chosen) if len(row) == len(table.columns) else row
        for row in table.rows
    ]
    return replace(table, columns=tuple(table.columns[i] for i in chosen), rows=tuple(rows))


def _least_width(table: Table, console: Console) -> int:
    """Number of characters of a line in which every number fits."""
    options = console.options.update(max_width=1_000)
    return Measurement.get(console, options, to_rich(table)).minimum


def to_rich(table: Table) -> RichTable:
    """The table as a renderable of rich; texts are printed literally, without markup."""
    shown = RichTable(
        title=Text(table.title) if table.title else None,
        caption=Text("\n".join(table.footnotes)) if table.footnotes else None,
        box=box.SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
        pad_edge=False,
        show_header=table.has_heads,
        title_justify="left",
        caption_justify="left",
    )
    full_rows = [row for row in table.rows if len(row) == len(table.columns)]
    for i, column in enumerate(table.columns):
        texts = [_lines(row[i]).plain for row in full_rows] + [column.title, column.unit]
        width = max(len(line) for text in texts for line in text.split("\n"))
        shown.add_column(
            Text("\n".join(filter(None, (column.title, column.unit)))),
            justify="left" if column.is_text else "right",
            no_wrap=not column.is_text,
            min_width=max(min(width, 20), *map(len, " ".join(texts).split(" ")))
            if column.is_text
            else width,
            overflow="fold",
        )
    for row in table.rows:
        if len(row) == len(table.columns):
            shown.add_row(*map(_lines, row))
        else:
            shown.add_section()
            shown.add_row(_lines(row[0]), style="bold")
    return shown


def to_html(table: Table) -> str:
    """Heads, rows and footnotes as an HTML table, for a notebook."""

    def line(cells: Iterable[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    heads = [", ".join(filter(None, (column.title, column.unit))) for column in table.columns]
    rows = [
        line((_lines(cell).plain for cell in row), "th" if len(row) == 1 else "td")
        for row in table.rows
    ]
    notes = "".join(f"<p>{escape(note)}</p>" for note in table.footnotes)
    return f"<table>{line(heads, 'th')}{''.join(rows)}</table>{notes}"


def to_markdown(table: Table) -> str:
    """Columns and rows in Markdown, without title and footnotes."""
    heads = [", ".join(filter(None, (column.title, column.unit))) for column in table.columns]
    lines = [_markdown_row(heads), "|---" * len(heads) + "|"]
    for row in table.rows:
        cells = [_as_cell(cell) for cell in row]
        texts = [f"{each.text} ({each.detail})" if each.detail else each.text for each in cells]
        lines.append(_markdown_row(texts + [""] * (len(heads) - len(texts))))
    return "\n".join(lines)


def _as_cell(cell: Cell | str) -> Cell:
    return Cell(cell) if isinstance(cell, str) else cell


def _lines(cell: Cell | str) -> Text:
    text, detail, status = _as_cell(cell)
    return Text("\n".join(filter(None, (text, detail))), style=_COLORS[status])


def _markdown_row(texts: list[str]) -> str:
    return "| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |"

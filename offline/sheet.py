"""A table of figures before it is a table on a terminal, in a card or on a page."""

from dataclasses import dataclass
from html import escape
from typing import NamedTuple

import numpy as np
from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from offline.bootstrap import Estimate
from offline.terminal import CONSOLE

NOTHING = "–"


class Cell(NamedTuple):
    """A figure, and the interval around it if there is one."""

    figure: str
    interval: str = ""


@dataclass(frozen=True, slots=True)
class Sheet:
    """One row a model, mostly, and one column a state."""

    title: str
    heads: tuple[tuple[str, str], ...]
    """words and unit of each column; the first column holds the rows' names"""
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]
    note: str = ""


PLAIN_BELOW = 1e7


def in_digits(number: float, digits: int = 4) -> str:
    """A number as every table shows it; large ones without powers of ten."""
    if np.isnan(number):
        return NOTHING
    text = f"{number:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(number) < PLAIN_BELOW else text


def cell(estimate: Estimate) -> Cell:
    """A single figure with its interval."""
    value, low, high = (float(part) for part in estimate)
    if not (np.isfinite(low) and np.isfinite(high)):
        return Cell(in_digits(value))
    return Cell(in_digits(value), f"{in_digits(low, 3)}{NOTHING}{in_digits(high, 3)}")


def cells(estimate: Estimate) -> tuple[Cell, ...]:
    """One figure (n,) after the other."""
    return tuple(cell(estimate.at(i)) for i in range(len(estimate.value)))


def print_sheet(sheet: Sheet) -> None:
    """On the terminal; a terminal too narrow breaks the lines, but no figure is cut."""
    table = Table(title=sheet.title, caption=sheet.note or None, box=box.SIMPLE_HEAD)
    table.title_justify = table.caption_justify = "left"
    for i, head in enumerate(sheet.heads):
        table.add_column(
            "\n".join(filter(None, head)), justify="right" if i else "left", no_wrap=True
        )
    for name, figures in sheet.rows:
        table.add_row(name, *("\n".join(filter(None, one)) for one in figures))
    needed = Measurement.get(CONSOLE, CONSOLE.options.update(max_width=1_000), table).maximum
    Console(width=max(CONSOLE.width, needed)).print(table)


def sheet_as_markdown(sheet: Sheet) -> str:
    """For a card, without title and note."""
    heads = [", ".join(filter(None, head)) for head in sheet.heads]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for name, figures in sheet.rows:
        shown = [
            f"{one.figure} ({one.interval})" if one.interval else one.figure for one in figures
        ]
        lines.append("| " + " | ".join([name, *shown]) + " |")
    return "\n".join(lines)


def sheet_as_html(sheet: Sheet) -> str:
    """For a page, without title; the note follows the table."""
    heads = "".join(
        f"<th>{escape(words)}" + (f"<br><i>{escape(unit)}</i>" if unit else "") + "</th>"
        for words, unit in sheet.heads
    )
    rows = "\n".join(
        f"<tr><th>{escape(name)}</th>"
        + "".join(
            f"<td>{escape(one.figure)}"
            + (f"<br><small>{escape(one.interval)}</small>" if one.interval else "")
            + "</td>"
            for one in figures
        )
        + "</tr>"
        for name, figures in sheet.rows
    )
    note = f"<p class='note'>{escape(sheet.note)}</p>" if sheet.note else ""
    return f"<table><tr>{heads}</tr>\n{rows}</table>{note}"

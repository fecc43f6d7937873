"""Logs in CSV, also compressed by gzip, bzip2 or xz."""

import bz2
import codecs
import csv
import gzip
import lzma
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain, islice
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import pandas as pd

from offline.logs.mapping import CsvSettings
from offline.logs.readers.log import (
    Log,
    Names,
    RowsOf,
    columns_to_read,
    readable,
    split_unit,
    to_log,
)
from rt_controller.contract.errors import DatasetError
from rt_controller.mapping.tables import DATE, TIME_OF_DAY, Clock

_DELIMITERS = (",", ";", "\t", "|")
_COMMENT = ("#", "%")
"""first characters of lines that numpy and MATLAB write before the rows"""
_KINDS: dict[str | None, str] = {DATE: "date", TIME_OF_DAY: "time such as 10:00:00.025"}
_HEAD_LINES = 1000
"""from the beginning, among which comments and header are"""
_MISSING = (
    *("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---"),
    *("nan(ind)", "-nan(ind)", "1.#qnan", "-1.#ind", "1.#ind"),
)
"""cells without a number, in lower case"""
_OPENERS: dict[str, Callable[..., Any]] = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}
_FAILURES = (OSError, EOFError, zlib.error, lzma.LZMAError, csv.Error)
CSV_SUFFIXES = tuple(
    plain + packed for plain in (".csv", ".tsv", ".txt") for packed in ("", *_OPENERS)
)


class _Layout(NamedTuple):
    """How the lines of a file are read."""

    delimiter: str
    """a space: any number of spaces"""
    names: list[str]
    units: list[str]
    """of the columns, from a line of their own; or empty"""
    skipped: int
    """lines before the first row"""

    def split(self, lines: Iterable[str]) -> Any:
        """A reader of the csv module that splits the lines into cells."""
        if self.delimiter == " ":
            lines = (" ".join(line.split()) for line in lines)
        return csv.reader(lines, delimiter=self.delimiter)


def read_csv(path: Path, wanted: Sequence[Names], time: Clock, style: CsvSettings) -> Log:
    """The wanted columns of a CSV file."""
    with _opened(path, style.encoding) as text:
        head = list(islice(text, max(_HEAD_LINES, style.header_line or 0, style.units_line or 0)))
        layout = _find_layout(path, head, style)
        if not {name for each in (time.names, *wanted) for name in each} & {
            each.name for each in map(split_unit, layout.names)
        }:
            _require_header(path, layout, style)
        columns = columns_to_read(path, wanted, time, layout.names)
        lines = chain(head[layout.skipped :], text)
        texts = _read_texts(path, lines, layout, columns.texts)
    frame = pd.DataFrame(index=texts.index)
    for column in columns.texts:
        kind = columns.text_time(column, time)
        frame[column] = _to_numbers(path, column, texts[column], style.decimal, kind)
    units = dict(zip(layout.names, layout.units, strict=False))
    return to_log(RowsOf(path, "line"), frame, columns, time, units.get)


@contextmanager
def _opened(path: Path, encoding: str) -> Iterator[TextIO]:
    """The text of the file; every failure to read it becomes a `DatasetError`."""
    opener = _OPENERS.get(path.suffix.lower(), open)
    try:
        with readable(path, "a CSV file", _FAILURES), opener(path, "rb") as file:
            is_utf16 = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        encoding = "utf-16" if is_utf16 else encoding
        with (
            readable(path, "a CSV file", _FAILURES),
            opener(path, "rt", encoding=encoding, newline="") as text,
        ):
            yield text
    except UnicodeDecodeError as error:
        raise DatasetError(
            f"{path}: expected text in {encoding}, found other bytes ({error.reason}). Name the "
            f'encoding in the mapping: [csv] encoding = "latin-1".'
        ) from error
    except LookupError as error:
        raise DatasetError(
            f"{path}: expected a known encoding, found {encoding!r}. Correct [csv] encoding."
        ) from error


def _find_layout(path: Path, head: Sequence[str], style: CsvSettings) -> _Layout:
    """The layout of a file with these first lines.

    The header is the first line that is no comment; or the last comment if numbers follow it.
    """
    comments = next(
        (k for k, line in enumerate(head) if line.strip() and not line.startswith(_COMMENT)),
        len(head),
    )
    header_line = style.header_line
    if header_line is None:
        first = head[comments].strip() if comments < len(head) else ""
        header_line = comments if comments and _is_row(first) else comments + 1
    skipped = max(header_line or comments, style.units_line or 0)
    if len(head) < max(skipped, 1):
        raise DatasetError(
            f"{path}: expected a header in line {max(skipped, 1)}, found {len(head)} lines. Leave "
            f"the file out, or correct [csv] header_line."
        )
    row = head[skipped] if skipped < len(head) else ""
    header = re.sub(r"^[#%]+\s*", "", head[header_line - 1]) if header_line else row
    delimiter = style.delimiter or _find_delimiter(header.strip(), row.strip())
    layout = _Layout(delimiter, [], [], skipped)
    names, units = (
        [cell.strip() for cell in next(layout.split([line]), [])]
        for line in (header, head[style.units_line - 1] if style.units_line else "")
    )
    if not header_line:
        names = [str(k + 1) for k in range(len(names))]
    return layout._replace(names=names, units=units)


def _find_delimiter(header: str, row: str) -> str:
    """The most frequent delimiter of the header; spaces if they split header and row alike."""
    delimiter = max(_DELIMITERS, key=header.count)
    if delimiter in header or not _are_numbers(row.split()):
        return delimiter
    return " " if len(header.split()) == len(row.split()) > 1 else delimiter


def _is_row(line: str) -> bool:
    """True if no cell is a name: numbers, dates, missing values."""
    cells = re.split(r"[,;|\s]+", line.replace('"', ""))
    return not any(cell[:1].isalpha() and cell.lower() not in _MISSING for cell in cells)


def _are_numbers(cells: Sequence[str]) -> bool:
    return bool(pd.to_numeric(pd.Series(cells), errors="coerce").notna().all())


def _require_header(path: Path, layout: _Layout, style: CsvSettings) -> None:
    """Return unless it is clear why a header has none of the wanted columns."""
    names, delimiter = layout.names, layout.delimiter
    if style.header_line != 0 and _are_numbers(names):
        raise DatasetError(
            f"{path}, line {layout.skipped}: expected a header that names the columns, found "
            f"numbers. Correct [csv] header_line; with header_line = 0 the columns are named 1, 2, "
            f"and so on."
        )
    others = [other for other in (*_DELIMITERS, " ") if other != delimiter and other in names[0]]
    if len(names) == 1 and others:
        raise DatasetError(
            f"{path}, line {layout.skipped}: expected names separated by {delimiter!r}, found one "
            f"name, {names[0]!r}. Write the delimiter: [csv] delimiter = {others[0]!r}."
        )


def _read_texts(
    path: Path, lines: Iterable[str], layout: _Layout, needed: Sequence[str]
) -> pd.DataFrame:
    """The cells of the needed columns, by line number; empty lines are left out."""
    reader, width = layout.split(lines), len(layout.names)
    columns: list[tuple[int, list[str]]] = [(layout.names.index(name), []) for name in needed]
    numbers = []
    for cells in reader:
        if not any(cells):
            continue
        line = layout.skipped + reader.line_num
        has_end = len(cells) == width + 1 and not cells[-1].strip()
        if len(cells) != width and not has_end:
            raise DatasetError(
                f"{path}, line {line}: expected {width} cells as in the header, found "
                f"{len(cells)}. The file may be truncated, or the delimiter is not "
                f"{layout.delimiter!r}: correct [csv] delimiter, or leave the line out."
            )
        numbers.append(line)
        for place, column in columns:
            column.append(cells[place])
    contents = {name: column for name, (_, column) in zip(needed, columns, strict=True)}
    return pd.DataFrame(contents, index=numbers, dtype=object)


def _to_numbers(
    path: Path, column: str, texts: pd.Series, decimal: str | None, text_time: str | None
) -> pd.Series:
    """The cells of a column as numbers, or as times; NaN or NaT where a cell is empty."""
    if text_time == DATE:
        values = pd.to_datetime(texts.str.strip(), format="ISO8601", utc=True, errors="coerce")
    elif text_time == TIME_OF_DAY:
        values = pd.to_timedelta(texts.str.strip().str.replace(",", "."), errors="coerce")
    else:
        values = pd.to_numeric(texts, errors="coerce")
        rest = texts[values.isna()]
        if decimal != "." and len(rest):
            values[rest.index] = pd.to_numeric(rest.str.replace(",", "."), errors="coerce")
    rest = texts[values.isna()].str.strip()
    wrong = rest[~rest.str.lower().isin(_MISSING)]
    if len(wrong):
        raise DatasetError(
            f"{path}, column {column}, line {wrong.index[0]}: expected a "
            f"{_KINDS.get(text_time, 'number')}, found {wrong.iloc[0]!r}. Correct or empty that "
            f"cell; a second header goes into [csv] units_line, a decimal comma into decimal = "
            f'",".'
        )
    return values

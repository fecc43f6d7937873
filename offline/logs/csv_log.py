"""Logs in CSV, also compressed by gzip, bzip2 or xz."""

import bz2
import csv
import gzip
import lzma
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from offline.logs.log import Log, foreign_file
from offline.logs.mapping import CsvSettings, TimeMapping
from offline.logs.table import Table, columns_to_read, require_table_columns, stamp
from rt_controller.contract.errors import DatasetError

SUFFIXES = (".csv", ".tsv")

_DELIMITERS = (",", ";", "\t", "|")
_NO_NUMBER = {"", "nan", "na", "n/a", "null", "none", "-"}
_OPENERS: dict[str, Callable[..., Any]] = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}
PACKED_SUFFIXES = tuple(_OPENERS)


def read_csv(path: Path, wanted: Sequence[str], time: TimeMapping, style: CsvSettings) -> Log:
    """The wanted columns of a CSV file.

    Raises:
        DatasetError: the file is damaged, a column is missing, or a cell is neither a number nor
            empty.
    """
    with _lines(path, style.encoding) as lines:
        table = _read_table(path, lines, wanted, time, style)
    return stamp(table, wanted, time)


@contextmanager
def _lines(path: Path, encoding: str) -> Iterator[TextIO]:
    """The text of the file; whatever goes wrong while it is read ends in one kind of error."""
    try:
        opener = _OPENERS.get(path.suffix.lower(), open)
        with opener(path, "rt", encoding=encoding, newline="") as text:
            yield text
    except UnicodeDecodeError as error:
        raise DatasetError(
            f"{path}: expected text in {encoding}, found bytes that are none ({error.reason}). "
            f'Name the encoding in the mapping: [csv] encoding = "latin-1".'
        ) from error
    except LookupError as error:
        raise DatasetError(
            f"{path}: expected a known encoding, found {encoding!r}. Correct [csv] encoding."
        ) from error
    except (OSError, EOFError, zlib.error, lzma.LZMAError, csv.Error) as error:
        raise foreign_file(path, "a CSV file", error) from error


def _read_table(
    path: Path,
    text: TextIO,
    wanted: Sequence[str],
    time: TimeMapping,
    style: CsvSettings,
) -> Table:
    head = _head(path, text, style)
    delimiter = style.delimiter or max(_DELIMITERS, key=head[style.header_line - 1].count)
    names = _split(head[style.header_line - 1], delimiter)
    if not set(names) & set(columns_to_read(wanted, time)):
        _require_header(path, names, delimiter, style.header_line)
    needed = require_table_columns(path, wanted, time, names)
    units: dict[str, str] = {}
    if style.units_line:
        units = dict(zip(names, _split(head[style.units_line - 1], delimiter), strict=False))
    places = [names.index(column) for column in needed]
    parse = [
        _date if column == time.column and time.unit == "iso8601" else _number for column in needed
    ]
    cells: list[list[float]] = [[] for _ in needed]
    row: list[int] = []
    reader = csv.reader(text, delimiter=delimiter)
    decimal = style.decimal
    for fields in reader:
        if not fields or not any(fields):
            continue
        line = len(head) + reader.line_num
        if len(fields) != len(names):
            raise DatasetError(
                f"{path}, line {line}: expected {len(names)} cells as in the header, found "
                f"{len(fields)}. The file may be truncated, or the delimiter is not "
                f"{delimiter!r}: say so in [csv] delimiter, or leave the line out."
            )
        for place, read, column, kept in zip(places, parse, needed, cells, strict=True):
            cell = fields[place].strip()
            if decimal is None and "," in cell:
                decimal = ","
            try:
                kept.append(read(cell.replace(",", ".") if decimal == "," else cell))
            except ValueError:
                raise DatasetError(
                    f"{path}, column {column}, line {line}: expected a number, found {cell!r}. "
                    f"Correct or empty that cell; a second header goes into [csv] units_line, a "
                    f'decimal comma into decimal = ",".'
                ) from None
        row.append(line)
    columns = {name: np.array(kept) for name, kept in zip(needed, cells, strict=True)}
    return Table(path, columns, np.array(row, dtype=np.int64), "line", units)


def _head(path: Path, text: TextIO, style: CsvSettings) -> list[str]:
    """The lines before the first row of numbers."""
    count = max(style.header_line, style.units_line or 0)
    head = [line.rstrip("\r\n") for _, line in zip(range(count), text, strict=False)]
    if len(head) < count:
        raise DatasetError(
            f"{path}: expected a header in line {count}, found {len(head)} lines. Leave the file "
            f"out, or correct [csv] header_line."
        )
    return head


def _require_header(path: Path, names: Sequence[str], delimiter: str, line: int) -> None:
    """Return unless it is plain why a line that should name columns names none that is wanted."""
    where = f"{path}, line {line}"
    if all(_is_number(name) for name in names):
        raise DatasetError(
            f"{where}: expected a header that names the columns, found numbers. Write one, or "
            f"correct [csv] header_line."
        )
    others = [other for other in (*_DELIMITERS, " ") if other != delimiter and other in names[0]]
    if len(names) == 1 and others:
        raise DatasetError(
            f"{where}: expected names with {delimiter!r} between them, found one name, "
            f"{names[0]!r}. Say what is between them: [csv] delimiter = {others[0]!r}."
        )


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _split(line: str, delimiter: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _number(cell: str) -> float:
    return float("nan") if cell.lower() in _NO_NUMBER else float(cell)


def _date(cell: str) -> float:
    return datetime.fromisoformat(cell).timestamp()

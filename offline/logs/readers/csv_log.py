"""Logs in CSV, also compressed by gzip, bzip2 or xz."""

import bz2
import csv
import gzip
import lzma
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

import pandas as pd

from offline.logs.mapping_tables import CsvSettings, TimeMapping
from offline.logs.readers.log import Log, readable
from offline.logs.readers.table import columns_to_read, to_log
from rt_controller.contract.errors import DatasetError

_DELIMITERS = (",", ";", "\t", "|")
_MISSING = ("", "nan", "na", "n/a", "null", "none", "-")
_OPENERS: dict[str, Callable[..., Any]] = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}
_FAILURES = (OSError, EOFError, zlib.error, lzma.LZMAError, csv.Error)
CSV_SUFFIXES = tuple(plain + packed for plain in (".csv", ".tsv") for packed in ("", *_OPENERS))


def read_csv(path: Path, wanted: Sequence[str], time: TimeMapping, style: CsvSettings) -> Log:
    """The wanted columns of a CSV file."""
    with _opened(path, style.encoding) as text:
        head = _read_head(path, text, style)
        header = head[style.header_line - 1]
        delimiter = style.delimiter or max(_DELIMITERS, key=header.count)
        names = _split(header, delimiter)
        if not {*wanted, time.column} & set(names):
            _require_header(path, names, delimiter, style.header_line)
        needed = columns_to_read(path, wanted, time, names)
        texts = _read_texts(path, text, delimiter, names, needed, len(head))
    frame = pd.DataFrame(index=texts.index)
    for column in needed:
        is_date = column == time.column and time.unit == "iso8601"
        frame[column] = _to_numbers(path, column, texts[column], style.decimal, is_date)
    units = _split(head[style.units_line - 1], delimiter) if style.units_line else []
    return to_log(path, frame, wanted, time, "line", dict(zip(names, units, strict=False)))


@contextmanager
def _opened(path: Path, encoding: str) -> Iterator[TextIO]:
    """The text of the file; every failure to read it becomes a `DatasetError`."""
    opener = _OPENERS.get(path.suffix.lower(), open)
    try:
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


def _read_head(path: Path, text: TextIO, style: CsvSettings) -> list[str]:
    """The lines before the first row of numbers."""
    count = max(style.header_line, style.units_line or 0)
    head = [line.rstrip("\r\n") for _, line in zip(range(count), text, strict=False)]
    if len(head) < count:
        raise DatasetError(
            f"{path}: expected a header in line {count}, found {len(head)} lines. Leave the file "
            f"out, or correct [csv] header_line."
        )
    return head


def _split(line: str, delimiter: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _require_header(path: Path, names: Sequence[str], delimiter: str, line: int) -> None:
    """Return unless it is clear why a header has none of the wanted columns."""
    if pd.to_numeric(pd.Series(names), errors="coerce").notna().all():
        raise DatasetError(
            f"{path}, line {line}: expected a header that names the columns, found numbers. Write "
            f"one, or correct [csv] header_line."
        )
    others = [other for other in (*_DELIMITERS, " ") if other != delimiter and other in names[0]]
    if len(names) == 1 and others:
        raise DatasetError(
            f"{path}, line {line}: expected names separated by {delimiter!r}, found one name, "
            f"{names[0]!r}. Write the delimiter: [csv] delimiter = {others[0]!r}."
        )


def _read_texts(
    path: Path, text: TextIO, delimiter: str, names: list[str], needed: list[str], skipped: int
) -> pd.DataFrame:
    """The cells of the needed columns, by line number; empty lines are left out."""
    reader = csv.reader(text, delimiter=delimiter)
    columns: list[tuple[int, list[str]]] = [(names.index(name), []) for name in needed]
    lines = []
    for cells in reader:
        if not any(cells):
            continue
        line = skipped + reader.line_num
        if len(cells) != len(names):
            raise DatasetError(
                f"{path}, line {line}: expected {len(names)} cells as in the header, found "
                f"{len(cells)}. The file may be truncated, or the delimiter is not {delimiter!r}: "
                f"correct [csv] delimiter, or leave the line out."
            )
        lines.append(line)
        for place, column in columns:
            column.append(cells[place])
    contents = {name: column for name, (_, column) in zip(needed, columns, strict=True)}
    return pd.DataFrame(contents, index=lines, dtype=object)


def _to_numbers(
    path: Path, column: str, texts: pd.Series, decimal: str | None, is_date: bool
) -> pd.Series:
    """The cells of a column as numbers, or as dates; NaN or NaT where a cell is empty."""
    if is_date:
        values = pd.to_datetime(texts.str.strip(), format="ISO8601", utc=True, errors="coerce")
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
            f"{'date' if is_date else 'number'}, found {wrong.iloc[0]!r}. Correct or empty that "
            f"cell; a second header goes into [csv] units_line, a decimal comma into decimal = "
            f'",".'
        )
    return values

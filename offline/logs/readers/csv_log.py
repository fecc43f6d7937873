"""Logs in CSV, also compressed by gzip, bzip2 or xz."""

import bz2
import codecs
import csv
import gzip
import lzma
import re
from collections.abc import Callable, Sequence
from itertools import islice
from typing import Any

import pandas as pd

from offline.logs.readers.log import Log, Request
from rt_controller.contract.errors import DatasetError
from rt_controller.mapping.tables import DATE, TIME_OF_DAY

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
OPENERS: dict[str, Callable[..., Any]] = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}


def read_csv(ask: Request) -> Log:
    """The wanted columns of a CSV file."""
    path, style = ask.path, ask.csv
    opener = OPENERS.get(path.suffix.lower(), open)
    with opener(path, "rb") as file:
        is_utf16 = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    encoding = "utf-16" if is_utf16 else style.encoding
    with opener(path, "rt", encoding=encoding, newline="") as file:
        head = list(islice(file, max(_HEAD_LINES, style.header_line or 0, style.units_line or 0)))
    delimiter, names, units, skipped = _find_layout(ask, head)
    try:
        columns = ask.choose(names)
    except DatasetError as error:
        raise DatasetError(
            f"{error} If these are no names, correct [csv] delimiter ({delimiter!r} is "
            f"used) or header_line; with header_line = 0 the columns are named 1, 2, and so on."
        ) from error
    wanted = list(dict.fromkeys(names.index(each.text) for each in columns))
    numbers, rows, width = list[int](), list[list[str]](), len(names)
    with opener(path, "rt", encoding=encoding, newline="") as file:
        lines = islice(file, skipped, None)
        reader = csv.reader(
            (" ".join(line.split()) for line in lines) if delimiter == " " else lines,
            delimiter=delimiter,
        )
        for row in reader:
            if not any(map(str.strip, row)):
                continue
            ends_with_delimiter = len(row) == width + 1 and not row[-1].strip()
            if len(row) != width and not ends_with_delimiter:
                raise DatasetError(
                    f"{path}, line {skipped + reader.line_num}: expected {width} cells as in the "
                    f"header, found {len(row)}. The file may be truncated: leave the line out, or "
                    f"correct [csv] delimiter ({delimiter!r} is used)."
                )
            numbers.append(skipped + reader.line_num)
            rows.append([row[k].strip() for k in wanted])
    texts = pd.DataFrame(rows, index=numbers, columns=wanted, dtype=str)
    frame = pd.DataFrame(index=texts.index)
    for k, column in enumerate(columns):
        cells, is_time = texts[names.index(column.text)], k == 0 and ask.clock.column
        if column.text not in frame:
            unit = ask.clock.unit if is_time else None
            frame[column.text] = _to_numbers(ask, column.text, cells, unit)
    return ask.to_log(frame, columns, dict(zip(names, units, strict=False)), "line")


def _find_layout(ask: Request, head: Sequence[str]) -> tuple[str, list[str], list[str], int]:
    """Delimiter (a space: any number of them), names, units, and lines before the first row.

    The header is the first line that is no comment; or the last comment if numbers follow it.
    """
    style = ask.csv
    comments = next(
        (k for k, line in enumerate(head) if line.strip() and not line.startswith(_COMMENT)),
        len(head),
    )
    header_line = style.header_line
    if header_line is None:
        first = head[comments] if comments < len(head) else ""
        header_line = comments if comments and _is_row(first) else comments + 1
    skipped = max(header_line or comments, style.units_line or 0)
    if len(head) < max(skipped, 1):
        raise DatasetError(
            f"{ask.path}: expected a header in line {max(skipped, 1)}, found {len(head)} lines. "
            f"Leave the file out, or correct [csv] header_line."
        )
    row = head[skipped].strip() if skipped < len(head) else ""
    header = re.sub(r"^[#%]+\s*", "", head[header_line - 1]).strip() if header_line else row
    delimiter = style.delimiter or max(_DELIMITERS, key=header.count)
    if not style.delimiter and delimiter not in header:
        is_spaced = pd.to_numeric(pd.Series(row.split()), errors="coerce").notna().all()
        if is_spaced and len(header.split()) == len(row.split()) > 1:
            delimiter = " "
    names = _split(header, delimiter)
    units = _split(head[style.units_line - 1], delimiter) if style.units_line else []
    if not header_line:
        names = [str(k + 1) for k in range(len(names))]
    return delimiter, names, units, skipped


def _split(line: str, delimiter: str) -> list[str]:
    """The cells of a line; one in quotes may contain the delimiter."""
    if delimiter == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line.strip()], delimiter=delimiter), [])]


def _is_row(line: str) -> bool:
    """True if no cell is a name: numbers, dates, missing values."""
    cells = re.split(r"[,;|\s]+", line.strip().replace('"', ""))
    return not any(cell[:1].isalpha() and cell.lower() not in _MISSING for cell in cells)


def _to_numbers(ask: Request, column: str, cells: pd.Series, unit: str | None) -> pd.Series:
    """The cells of a column as numbers, or as times; NaN or NaT where a cell is empty."""
    if unit == DATE:
        values = pd.to_datetime(cells, format="ISO8601", utc=True, errors="coerce")
    elif unit == TIME_OF_DAY:
        values = pd.to_timedelta(cells.str.replace(",", "."), errors="coerce")
    else:
        values = pd.to_numeric(cells, errors="coerce")
        rest = cells[values.isna()]
        if ask.csv.decimal != "." and len(rest):
            values[rest.index] = pd.to_numeric(rest.str.replace(",", "."), errors="coerce")
    wrong = cells[values.isna() & ~cells.str.lower().isin(_MISSING)]
    if len(wrong):
        raise DatasetError(
            f"{ask.path}, column {column}, line {wrong.index[0]}: expected a "
            f"{_KINDS.get(unit, 'number')}, found {wrong.iloc[0]!r}. Correct or empty that "
            f"cell; a second header goes into [csv] units_line, a decimal comma into decimal = "
            f'",".'
        )
    return values

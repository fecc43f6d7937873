"""Tables on the terminal and in Markdown."""

from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from rt_controller.report.table import (
    Cell,
    Column,
    Fact,
    Table,
    facts_table,
    format_number,
    print_table,
    print_text,
    to_markdown,
)

TABLE = Table(
    "Errors [red] of all models",
    (Column("model", is_text=True), Column("vx", "km/h"), Column("verdict")),
    (
        ("first car",),
        ("lti [bold]", Cell("0.1234", "0.101–0.149"), Cell("missed", status="bad")),
        ("mdk|net", "12345", Cell("ok", status="good")),
    ),
    ("a note",),
)


def printed(table, width):
    file = StringIO()
    print_table(table, Console(file=file, width=width))
    return file.getvalue()


@pytest.mark.parametrize("width", [10, 80])
def test_terminal_shows_every_text_in_full_however_narrow_it_is(width):
    lines = printed(TABLE, width).splitlines()
    assert lines == [line.rstrip() for line in lines]
    text = " ".join(" ".join(lines).split())
    for shown in ("Errors [red] of all models", "0.1234", "0.101–0.149", "first car",
                  "lti [bold]", "12345", "missed", "a note", "km/h"):  # fmt: skip
        assert shown in text


def test_long_text_wraps_inside_the_terminal():
    text = printed(facts_table([Fact("name", "words " * 40)]), 60)
    assert max(map(len, text.splitlines())) <= 60
    assert text.count("words") == 40


@pytest.mark.parametrize(
    ("is_terminal", "lines"), [(True, ["at 80 km/h", "[x]."]), (False, ["at 80 km/h [x]."])]
)
def test_sentences_wrap_at_spaces_on_a_terminal_only(is_terminal, lines):
    file = StringIO()
    print_text("at 80 km/h [x].", Console(file=file, width=10, force_terminal=is_terminal))
    assert [line.rstrip() for line in file.getvalue().splitlines()] == lines


def test_a_word_is_broken_only_if_it_is_wider_than_the_terminal():
    long = "w" * 40
    assert long in printed(facts_table([Fact("name", f"a few words, {long}, and more")]), 60)


@pytest.mark.parametrize("columns", [2, 13, 30])
def test_a_wide_table_is_printed_in_parts_of_80_columns_that_repeat_its_names(columns):
    heads = (
        Column("signal", is_text=True),
        *(Column(f"state {i}", "m/s^2") for i in range(columns)),
    )
    rows = (("a heading",), *((f"row {k}", *["-0.12345"] * columns) for k in range(3)))
    text = printed(Table("wide", heads, rows, ("the note",)), 80)
    assert max(map(len, text.splitlines())) <= 80
    assert text.count("-0.12345") == 3 * columns
    assert text.count("row 2") == text.count("signal")
    assert text.count("the note") == text.count("wide") == 1
    assert all(f"state {i}" in text for i in range(columns))


def test_markdown_has_the_detail_in_brackets_and_escapes_bars():
    assert to_markdown(TABLE).splitlines() == [
        "| model | vx, km/h | verdict |",
        "|---|---|---|",
        "| first car |  |  |",
        "| lti [bold] | 0.1234 (0.101–0.149) | missed |",
        "| mdk\\|net | 12345 | ok |",
    ]


@pytest.mark.parametrize(
    ("number", "text"),
    [(0.0012345, "0.001234"), (123456.0, "123500"), (1.5e9, "1.5e+09"), (np.nan, "–"),
     (np.inf, "inf"), (-0.0, "0")],
)  # fmt: skip
def test_numbers_have_four_digits_and_powers_of_ten_only_when_large(number, text):
    assert format_number(number) == text


def test_texts_behind_the_numbers_of_a_wide_table_stand_below_the_name():
    heads = (
        Column("line", is_text=True),
        Column("reached"),
        *(Column(title, is_text=True) for title in ("kind", "remark")),
    )
    rows = (("a heading",), ("roll", "4.476", "measured", "words " * 20))
    table = Table("", heads, rows)
    wide, narrow = printed(table, 200).splitlines(), printed(table, 40).splitlines()
    assert any("roll" in line and "measured" in line for line in wide)
    (row,) = (k for k, line in enumerate(narrow) if "roll" in line)
    assert "4.476" in narrow[row]
    assert "measured" in narrow[row + 1]
    assert max(map(len, narrow)) <= 40

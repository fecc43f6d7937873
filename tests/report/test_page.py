"""The page: complete, escaped, and without any access to the network."""

import re
import sys

import pytest

from rt_controller.contract.errors import MissingExtraError
from rt_controller.report.canvas import empty_figure
from rt_controller.report.page import Page, Plot, Section, render_page, require_report_extra
from rt_controller.report.table import Cell, Column, Table

TABLE = Table(
    "Title <t>",
    (Column("model", is_text=True), Column("vx", "km/h")),
    (("car <x>",), ("lti", Cell("1.2", "1–3", "bad"))),
    ("note <n>",),
)


def made_page(figure):
    parts = ("5 % of <b>", Plot(figure, "caption"), TABLE)
    return Page("Report <r>", (Section("One", parts),), ("first",))


def test_page_with_static_plots_loads_nothing_and_runs_no_script():
    html = render_page(made_page(empty_figure(1, 1, 1.0)[0]))
    assert not re.findall(r'\b(?:src|href|srcset|data)="[^#]', html)
    for word in ("<script", "@import", "url(http", "<link", "<iframe"):
        assert word not in html


def test_page_shows_all_parts_and_escapes_their_texts():
    figure, _ = empty_figure(1, 1, 1.0)
    html = render_page(made_page(figure))
    for text in ("Report &lt;r&gt;", "<h2>One</h2>", "5\u00a0% of &lt;b&gt;", "<svg", "caption",
                 "Title &lt;t&gt;", "car &lt;x&gt;", "<i>km/h</i>",
                 '"vx, km/h"><span class="bad">1.2</span><br><small>1–3</small></td>',
                 "note &lt;n&gt;", "<p>first</p>"):  # fmt: skip
        assert text in html


def test_same_content_gives_the_same_page():
    pages = [render_page(made_page(empty_figure(1, 2, 1.0)[0])) for _ in range(2)]
    assert pages[0] == pages[1]


def test_missing_package_is_named_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(MissingExtraError, match=r"--html needs jinja2: .*pip install .*\[report\]"):
        require_report_extra("--html")

"""Pieces of HTML that the report is put together from; what comes in is escaped."""

from collections.abc import Sequence
from html import escape

from matplotlib.figure import Figure

from offline.card import Fact
from offline.report.canvas import as_svg
from offline.sheet import Sheet, sheet_as_html

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1f2933; background: #fff;
       max-width: 1080px; margin: 2rem auto; padding: 0 1.5rem; }
h1 { font-size: 1.6rem; margin-bottom: .2rem; }
h2 { font-size: 1.2rem; margin: 2.8rem 0 .6rem; border-top: 1px solid #d9e0e7; padding-top: 1rem; }
h3 { font-size: .98rem; margin: 1.6rem 0 .4rem; }
p, li { max-width: 46rem; color: #3e4c59; }
p.note { font-size: .85rem; color: #616e7c; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .88rem; }
th, td { padding: .25rem .9rem .25rem 0; text-align: right; vertical-align: top;
         border-bottom: 1px solid #edf1f5; }
th { color: #52606d; font-weight: 600; } th i { font-weight: 400; }
th:first-child { text-align: left; white-space: nowrap; }
td small { color: #7b8794; white-space: nowrap; }
table.facts td { text-align: left; overflow-wrap: anywhere; }
figure { margin: 1rem 0; } figure svg { max-width: 100%; height: auto; }
figcaption { font-size: .85rem; color: #616e7c; max-width: 46rem; }
details { margin: .8rem 0; } summary { cursor: pointer; color: #2f6fb3; }
code { font-size: .85em; } .scroll { overflow-x: auto; }
"""


def document(title: str, chapters: Sequence[str]) -> str:
    """A page with its style in it; nothing is loaded from anywhere."""
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width'>"
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>{escape(title)}</h1>\n" + "\n".join(filter(None, chapters)) + "\n</body></html>\n"
    )


def chapter(title: str, words: str, *parts: str) -> str:
    """A heading, an introduction if there are words, and what follows."""
    intro = f"<p>{prose(words)}</p>" if words else ""
    return f"<section><h2>{escape(title)}</h2>{intro}{''.join(parts)}</section>"


def prose(words: str) -> str:
    """Words whose percent signs do not slip into the next line."""
    return escape(words).replace(" %", "&nbsp;%")


def titled(sheet: Sheet) -> str:
    """A table under its title."""
    return f"<h3>{escape(sheet.title)}</h3><div class='scroll'>{sheet_as_html(sheet)}</div>"


def drawn(drawing: Figure, caption: str) -> str:
    """A drawing as a part of the page."""
    under = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure role='img' aria-label='{escape(caption)}'>{as_svg(drawing)}{under}</figure>"


def facts_table(facts: Sequence[Fact]) -> str:
    """One line a fact."""
    rows = "".join(f"<tr><th>{escape(f.name)}</th><td>{escape(f.value)}</td></tr>" for f in facts)
    return f"<table class='facts'>{rows}</table>"


def listed(names: Sequence[str]) -> str:
    """Names with commas and an "and"."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))

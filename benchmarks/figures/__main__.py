"""`python -m benchmarks.figures`: the results that README and docs print, and their tables.

A table stands between `<!-- figures: NAME -->` and `<!-- end -->`.
"""

import re
from collections.abc import Mapping
from operator import call
from pathlib import Path
from typing import Annotated

import cyclopts
from rich.console import Console

from benchmarks.figures import closed_loop
from benchmarks.figures.results import SOURCES, Part, Results, read_import
from benchmarks.figures.tables import blocks
from offline.commands.options import JsonFile, Several
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.model.artifact import SHIPPED_MODEL
from rt_controller.terminal.command_line import run_command
from sim_bridge.campaign import THIS_MACHINE, Backend, run_campaign

MEASURED = "closed_loop"
"""the piece that is measured here; those of `SOURCES` are imported"""
ROOT = Path(__file__).parents[2]
EXIT_DIFFERENT = 1

app = cyclopts.App(name="python -m benchmarks.figures", version_flags=[])


@app.default
def main(
    *,
    imports: Annotated[tuple[Path, ...], Several, cyclopts.Parameter(name="--import")] = (),
    again: Annotated[bool, cyclopts.Parameter(negative="")] = False,
    tables: Annotated[bool, cyclopts.Parameter(negative="")] = False,
    check: Annotated[bool, cyclopts.Parameter(negative="")] = False,
    root: Annotated[Path, cyclopts.Parameter(show=False)] = ROOT,
    backend: Backend = THIS_MACHINE,
    json: JsonFile = None,
) -> int:
    """Measure what is missing in docs/figures.json, and write the tables of README.md and docs.

    Each drive is stored when it is finished: an interrupted run goes on with the same command. A
    drive is made again if its model has changed. After a change of the controller or the simulated
    car, use --again.

    Args:
        imports: JSON files of offline-evaluate, benchmarks.fault_matrix, benchmarks.false_alarms
            and benchmarks.paper, of the shipped models.
        again: forget the drives that the file has, then measure.
        tables: measure nothing, write the tables only.
        check: measure and write nothing; exit code 1 if a table is not that of the file, or the
            file is not of the shipped models.
    """
    require_writable(json)
    console = Console(stderr=True, soft_wrap=True)
    results = Results(root / "docs" / "figures.json")
    for file in () if check else imports:
        piece, part = read_import(file)
        results.put(piece, part, part.measure())
    if not (tables or check):
        _measure(results, again, backend, console)
    write_figures(json, results.found)
    return _update_documents(root, results, check, console)


def _measure(results: Results, again: bool, backend: Backend, console: Console) -> None:
    parts = list(closed_loop.parts())
    if again:
        results.keep(MEASURED, ())  # when interrupted, the command without --again goes on
    missing = {part.name: part for part in results.missing(MEASURED, parts)}
    tasks = [(name, (part.measure,)) for name, part in missing.items()]
    found = run_campaign(call, tasks, backend)  # the results file keeps them
    for number, (name, figures) in enumerate(found, 1):
        console.print(f"{number}/{len(missing)}: {name}", highlight=False)
        results.put(MEASURED, missing[name], figures)
    results.keep(MEASURED, [part.name for part in parts])


def _update_documents(root: Path, results: Results, check: bool, console: Console) -> int:
    pieces = {MEASURED: list(closed_loop.parts())}
    pieces |= {name: [Part("all", (SHIPPED_MODEL,), dict)] for name in SOURCES}
    outdated = [name for name in results.found if results.missing(name, pieces.get(name, []))]
    complete = results.found.keys() - set(outdated)
    for name in [name for name in pieces if name not in complete]:
        console.print(f"{name}: no results of the shipped models, its tables stay as they are")
    texts, is_changed, tables = blocks(results.pieces, complete), False, 0
    files = (root / "README.md", *sorted((root / "docs").rglob("*.md")))
    for file in files:
        before = file.read_text(encoding="utf-8")
        after = replace_blocks(before, texts, str(file))
        tables += len(_BLOCK.findall(before))
        if before != after:
            is_changed = True
            console.print(f"{file}: {'differs from the results' if check else 'written'}")
            if not check:
                file.write_text(after, encoding="utf-8")
    for name in outdated:
        console.print(f"{name}: outdated, not of the shipped models")
    if check:
        state = "differences as listed" if is_changed or outdated else "all up to date"
        console.print(
            f"checked {tables} tables in {len(files)} files, of {len(pieces[MEASURED])} drives: "
            f"{state}",
            highlight=False,
        )
    return EXIT_DIFFERENT if check and (is_changed or outdated) else 0


_MARKER = re.compile(r"^<!-- figures: (\S+) -->$", re.MULTILINE)
_BLOCK = re.compile(
    r"^(<!-- figures: (\S+) -->\n)(?:(?!^<!-- figures).)*?^<!-- end -->$", re.DOTALL | re.MULTILINE
)


def replace_blocks(text: str, blocks: Mapping[str, str | None], where: str) -> str:
    """The text with the content of each block; a block whose text is None stays as it is.

    Raises:
        ConfigError: a marker names no block, or has no end.
    """
    found = list(_BLOCK.finditer(text))
    unknown = {match[2] for match in found} - blocks.keys()
    if unknown or len(found) != len(_MARKER.findall(text)):
        raise ConfigError(
            f"{where}: expected markers of {', '.join(blocks)}, each with <!-- end --> after it, "
            f"found {', '.join(sorted(unknown)) or 'one without an end'}. Correct the marker."
        )

    def replaced(match: re.Match[str]) -> str:
        block = blocks[match[2]]
        return match[0] if block is None else f"{match[1]}\n{block}\n\n<!-- end -->"

    return _BLOCK.sub(replaced, text)


if __name__ == "__main__":
    run_command(app)

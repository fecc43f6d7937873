"""What every command of the project shares: version, messages, exit codes.

Imported before anything heavy, so that `--help` and a mistyped option answer at once.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from importlib.metadata import version
from typing import Any

from cyclopts import App, CycloptsError, MissingArgumentError
from pydantic import BaseModel
from rich.console import Console

from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.contract.settings_errors import explain, option, with_options

INTERRUPTED = 130
"""exit code after Ctrl-C, as a shell expects it"""


def new_app(name: str, help_text: str, arguments: str = "") -> App:
    """A command with `--help`, `--version` (of the distribution) and `--install-completion`.

    `arguments` are those that the usage line names.
    """
    # Markdown, the default, would import a parser and colours for source code.
    app = App(
        name=name,
        help=help_text,
        help_format="plaintext",
        version=lambda: version("rt-controller"),
    )
    app.usage = " ".join(["Usage:", name, *arguments.split(), "[OPTIONS]"])
    app.register_install_completion_command()
    return app


def run_command(app: App, arguments: Sequence[str] | None = None) -> None:
    """Parse the arguments, run the command, and end the process with its exit code.

    An error ends with one message on stderr and its own exit code: 2 for options that are refused,
    all of them named at once, otherwise the one of the `RtControllerError`.
    """
    program = app.name[0]
    tokens = sys.argv[1:] if arguments is None else arguments
    try:
        sys.exit(_call(app, tokens))
    except RtControllerError as error:
        print_error(program, with_options(str(error), _options_of(app, tokens)))
        sys.exit(error.exit_code)


def print_error(program: str, message: str) -> None:
    """Print a message on stderr in red, never wrapped and never read as markup.

    A message may contain brackets and long paths, which must stay as they are.
    """
    Console(stderr=True).print(
        f"{program}: {message}", style="red", markup=False, highlight=False, soft_wrap=True
    )


def _call(app: App, arguments: Sequence[str]) -> int:
    asks_for_help = bool({"--help", "-h"} & set(arguments))
    entry: Callable[..., Any] = app.meta if app.meta.default_command is not None else app
    try:
        with _short_search_for_help() if asks_for_help else nullcontext():
            code = entry(
                arguments, exit_on_error=False, print_error=False, result_action="return_value"
            )
    except CycloptsError as error:
        raise ConfigError(_explain_usage(error)) from error
    return code if isinstance(code, int) else 0


def _explain_usage(error: CycloptsError) -> str:
    refused = error.__cause__
    if refused is not None and hasattr(refused, "errors"):
        return explain(refused, option)
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        choices = error.argument.get_choices()
        such_as = f", such as {', '.join(choices)}" if choices else ""
        return f"{error.argument.name}: expected a value{such_as}, found none."
    return " ".join(str(error).split())


def _options_of(app: App, arguments: Sequence[str]) -> set[str]:
    """Names of the options of the command that the arguments choose."""
    *_, command = app.parse_commands(arguments)[1]
    if command.default_command is None:
        return set()
    return {name for found in command.assemble_argument_collection() for name in found.names}


@contextmanager
def _short_search_for_help() -> Iterator[None]:
    """Within it cyclopts does not look for help texts in the source of pydantic's `BaseModel`.

    It reads the source of all base classes of each table of options. That one is long, contains
    none, and takes a quarter of the time of `--help`: its docstring counts as empty. Line breaks
    in a help text become blanks.
    """
    import docstring_parser
    from docstring_parser import Docstring, DocstringStyle

    parse = docstring_parser.parse_from_object

    def parse_short(obj: Any, style: DocstringStyle = DocstringStyle.AUTO) -> Docstring:
        found = Docstring() if obj is BaseModel else parse(obj, style)
        for parameter in found.params:
            parameter.description = " ".join((parameter.description or "").split())
        return found

    docstring_parser.parse_from_object = parse_short
    try:
        yield
    finally:
        docstring_parser.parse_from_object = parse

"""What every command of the project shares: version, messages, exit codes.

Imported before anything heavy, so that `--help` and a mistyped option answer at once.
"""

import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Any

from cyclopts import App, CycloptsError
from rich.console import Console

from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.contract.settings_errors import explain, option

INTERRUPTED = 130
"""exit code after Ctrl-C, as a shell expects it"""


def new_app(name: str, help_text: str) -> App:
    """A command with `--help`, `--version` (of the distribution) and `--install-completion`."""
    app = App(name=name, help=help_text, version=lambda: version("rt-controller"))
    app.register_install_completion_command()
    return app


def run_command(app: App, arguments: Sequence[str] | None = None) -> None:
    """Parse the arguments, run the command, and end the process with its exit code.

    An error ends with one message on stderr and its own exit code: 2 for options that are refused,
    all of them named at once, otherwise the one of the `RtControllerError`.
    """
    program = app.name[0]
    try:
        sys.exit(_call(app, sys.argv[1:] if arguments is None else arguments))
    except RtControllerError as error:
        print_error(program, str(error))
        sys.exit(error.exit_code)


def print_error(program: str, message: str) -> None:
    """Print a message on stderr in red, never wrapped and never read as markup.

    A message may contain brackets and long paths, which must stay as they are.
    """
    Console(stderr=True).print(
        f"{program}: {message}", style="red", markup=False, highlight=False, soft_wrap=True
    )


def _call(app: App, arguments: Sequence[str]) -> int:
    entry: Callable[..., Any] = app.meta if app.meta.default_command is not None else app
    try:
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
    return " ".join(str(error).split())

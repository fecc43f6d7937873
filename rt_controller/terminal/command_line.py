"""What every command of the project shares: version, messages, exit codes.

Imported before anything heavy, so that `--help` and a mistyped option answer at once.
"""

import errno
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, TextIO

from cyclopts import (
    App,
    CycloptsError,
    MissingArgumentError,
    UnknownOptionError,
    UnusedCliTokensError,
)
from rich.console import Console, ConsoleOptions
from rich.text import Text

from rt_controller.contract.errors import ConfigError, OutputError, RtControllerError
from rt_controller.contract.names import hint
from rt_controller.contract.settings_errors import Location, dotted, explain, option, with_options
from rt_controller.terminal.entry import INTERRUPTED, SENTENCE

if TYPE_CHECKING:
    from cyclopts.help import HelpEntry, HelpPanel

_HELP_ALL = "--help-all"
_SHORT_LIST = 13
"""options of a command that `--help` shows all, whatever their names"""


def new_app(
    name: str, help_text: str, arguments: str = "", groups: Mapping[str, str] | None = None
) -> App:
    """A command with `--help`, `--version` (with the git revision) and `--install-completion`.

    Args:
        name: of the program.
        help_text: what it does, and its exit codes.
        arguments: those that the usage line names.
        groups: names of options by the title of their group. Of a long list `--help` shows the
            first group only. Others are grouped by the part of their name before the last dot.
    """
    # Markdown, the default, would import a parser and colours for source code.
    app = App(
        name=name,
        help=help_text,
        help_format="plaintext",
        version=_version,
        help_flags=("--help", "-h", _HELP_ALL),
    )
    app.help_formatter = _HelpFormatter(groups or {"Main options": ""})
    app.usage = " ".join(["Usage:", name, *arguments.split(), "[OPTIONS]"])
    app.register_install_completion_command()
    return app


def _version() -> str:
    """Version of the distribution, and the git revision if it is known."""
    from rt_controller.contract.revision import source_revision

    revision = source_revision()
    known = "" if revision == "unknown" else f" ({revision})"
    return version("rt-controller") + known


def run_command(app: App, arguments: Sequence[str] | None = None) -> None:
    """Parse the arguments, run the command, and end the process with its exit code.

    An error ends with one message on stderr and its own exit code: 2 for options that are refused,
    all of them named at once, otherwise the one of the `RtControllerError`.
    """
    program = app.name[0]
    tokens = sys.argv[1:] if arguments is None else arguments
    _protect_streams()
    try:
        code = _call(app, tokens)
    except (RtControllerError, OSError) as error:
        explained = _explain_file_error(error) if isinstance(error, OSError) else error
        print_error(program, with_options(str(explained), _options_of(app, tokens)))
        code = explained.exit_code
    except KeyboardInterrupt:
        Console(stderr=True).show_cursor()  # a spinner that was just starting has hidden it
        print_error(program, SENTENCE)
        code = INTERRUPTED
    sys.exit(code)


class _LossyStream:
    """A stream that discards what cannot be written.

    A drive must not end because the pipe, the terminal or the disk of its output is gone.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        with suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _protect_streams() -> None:
    """Make stdout and stderr of this process lossy; others that replace them are left alone."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is not None and stream is getattr(sys, f"__{name}__"):
            stream.reconfigure(errors="backslashreplace")
            setattr(sys, name, _LossyStream(stream))


def print_error(program: str, message: str) -> None:
    """Print a message on stderr in red, never wrapped and never read as markup.

    A message may contain brackets and long paths, which must stay as they are.
    """
    Console(stderr=True, emoji=False).print(
        f"{program}: {message}", style="red", markup=False, highlight=False, soft_wrap=True
    )


def _explain_file_error(error: OSError) -> RtControllerError:
    """The message for a file that no other code has explained; another error is raised again."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return OutputError(
            f"{error.filename or 'A file'}: expected room to write, found {error.strerror}. Free "
            f"some space, or choose another folder, and start again."
        )
    if error.filename is None:
        raise error
    return ConfigError(
        f"{error.filename}: expected a file or folder that can be read and written, found "
        f"{error.strerror}. Correct its path or its permissions, or name another one."
    )


def _call(app: App, arguments: Sequence[str]) -> int:
    entry = app.meta if app.meta.default_command is not None else app
    app.suppress_keyboard_interrupt = entry.suppress_keyboard_interrupt = False
    try:
        code = entry(
            arguments, exit_on_error=False, print_error=False, result_action="return_value"
        )
    except CycloptsError as error:
        raise ConfigError(_explain_usage(error, app, arguments)) from error
    return code if isinstance(code, int) else 0


def _stray_word(error: CycloptsError, app: App, arguments: Sequence[str]) -> str:
    """The first word that belongs to no option and that the command does not take; else empty."""
    if isinstance(error, UnusedCliTokensError):
        return next(iter(error.unused_tokens or ()), "")
    *_, command = app.parse_commands(arguments)[1]
    words = app.parse_commands(arguments)[2]
    if not words or words[0].startswith("-") or command.default_command is None:
        return ""
    taken = command.assemble_argument_collection()
    return "" if any(each.index is not None for each in taken) else words[0]


def _explain_usage(error: CycloptsError, app: App, arguments: Sequence[str]) -> str:
    refused = error.__cause__
    if refused is not None and hasattr(refused, "errors"):
        written = "" if error.argument is None else error.argument.name

        def name_of(place: Location) -> str:
            """A field of a table of options, or an option of its own, or a part of that."""
            is_field = place[:1] and isinstance(place[0], str)
            return option(place) if is_field else written + dotted(place)

        return explain(refused, name_of)
    names = [*_options_of(app, arguments), *(name for name in app if name[0] != "-")]
    if word := _stray_word(error, app, arguments):
        near = hint(word, names) or hint(f"--{word}", names)
        return f"{word!r} is neither an option nor a command{near}. --help lists what there is."
    if isinstance(error, UnknownOptionError) and error.token.source == "cli":
        written = error.token.keyword or error.token.value
        return f"{written}: no such option{hint(written, names)}. --help lists what there is."
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


class _HelpFormatter:
    """Prints a short list of options as it is, and a long one shortened, or in its groups."""

    def __init__(self, groups: Mapping[str, str]) -> None:
        self.groups = groups
        self._titles = {name: title for title, names in groups.items() for name in names.split()}

    def render_usage(self, console: Console, options: ConsoleOptions, usage: object) -> None:
        from cyclopts.help import DefaultFormatter  # here, since only the help needs it

        DefaultFormatter().render_usage(console, options, usage)

    def __call__(self, console: Console, options: ConsoleOptions, panel: "HelpPanel") -> None:
        from cyclopts.help import DefaultFormatter

        show = partial(DefaultFormatter(), console, options)
        for entry in panel.entries:
            text = getattr(entry.description, "primary_renderable", None)
            if isinstance(text, Text):
                text.plain = " ".join(text.plain.split())  # of lines of a docstring
        if panel.format != "parameter" or len(panel.entries) <= _SHORT_LIST:
            show(panel)
            return
        found: dict[str, list[HelpEntry]] = {title: [] for title in self.groups}
        for entry in panel.entries:
            name = entry.display_labels[0].removeprefix("--")
            prefix = name.rpartition(".")[0]
            title = self._titles.get(name, f"--{prefix}" if prefix else str(panel.title))
            found.setdefault(title, []).append(entry)
        shows_all = _HELP_ALL in sys.argv
        for title, entries in list(found.items())[: None if shows_all else 1]:
            if entries:
                show(panel.copy(title=title, entries=entries))
        if not shows_all:
            console.print(f"All options: {_HELP_ALL}")

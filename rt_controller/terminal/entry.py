"""Start of a command: Ctrl-C ends it with one line, also while its modules are being imported.

Imports nothing heavy. An exception that Ctrl-C raises during an import would end in a traceback, or
in another error of the module that is half initialised.
"""

import os
import signal
import sys
from contextlib import suppress
from importlib import import_module
from types import FrameType

INTERRUPTED = 130
"""exit code after Ctrl-C, as a shell expects it"""
SENTENCE = "ended by Ctrl-C"
_IMPORTER = "<frozen importlib._bootstrap>"


def start(program: str, module: str, function: str = "main") -> None:
    """Import `module` and call its `function`; `program` is named if Ctrl-C ends it.

    An ignored Ctrl-C, as of a job in the background, stays ignored.
    """

    def interrupt(_: int, frame: FrameType | None) -> None:
        """End at once during an import; otherwise raise, so that the command can clean up."""
        if not _is_importing(frame):
            raise KeyboardInterrupt
        _tell(program)
        os._exit(INTERRUPTED)

    try:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, interrupt)
        getattr(import_module(module), function)()
    except KeyboardInterrupt:
        _tell(program)
        sys.exit(INTERRUPTED)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the interpreter ends


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == _IMPORTER:
            return True
        frame = frame.f_back
    return False


def _tell(program: str) -> None:
    with suppress(OSError):
        os.write(2, f"{program}: {SENTENCE}\n".encode())

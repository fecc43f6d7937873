"""Start of a command: Ctrl-C ends it with one line, also while its modules are being imported.

Imports nothing heavy. An exception that Ctrl-C raises during an import would end in a traceback, or
in another error of the module that is half initialised.
"""

import os
import signal
import sys
import threading
from importlib import import_module
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130
"""exit code after Ctrl-C, as a shell expects it"""
SENTENCE = "ended by Ctrl-C"
_IMPORT = "<frozen importlib._bootstrap>"
"""file name of the code that imports a module"""


def start(program: str, module: str, function: str = "main") -> None:
    """Import `module` and call its `function`; `program` is named if Ctrl-C ends it.

    An ignored Ctrl-C, as of a job in the background, stays ignored.
    """
    message = f"{program}: {SENTENCE}\n".encode()
    try:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, lambda _, frame: _interrupt_or_exit(frame, message))
        getattr(import_module(module), function)()
    except KeyboardInterrupt:
        os.write(2, message)
        sys.exit(INTERRUPTED)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the interpreter ends


def interrupt() -> NoReturn:
    """Raise KeyboardInterrupt, so that everything in progress cleans up.

    Threads may fail when their work is taken away: they no longer say so.
    """
    threading.excepthook = lambda _: None
    raise KeyboardInterrupt


def _interrupt_or_exit(frame: FrameType | None, message: bytes) -> None:
    """Interrupt; while a module is imported end the process, and those that it started."""
    while frame is not None and frame.f_code.co_filename != _IMPORT:
        frame = frame.f_back
    if frame is None:
        interrupt()
    if processes := sys.modules.get("multiprocessing"):
        for each in processes.active_children():
            each.terminate()
    # A spinner may have hidden the cursor.
    os.write(2, b"\x1b[?25h" + message if os.isatty(2) else message)
    os._exit(INTERRUPTED)

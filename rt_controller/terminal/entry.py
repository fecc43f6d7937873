"""Start of a command: Ctrl-C ends it with one line, also while its modules are being imported.

Imports nothing heavy. An exception that Ctrl-C raises during an import would end in a traceback, or
in another error of the module that is half initialised.
"""

import os
import signal
import sys
from importlib import import_module

INTERRUPTED = 130
"""exit code after Ctrl-C, as a shell expects it"""
SENTENCE = "ended by Ctrl-C"


def start(program: str, module: str, function: str = "main") -> None:
    """Import `module` and call its `function`; `program` is named if Ctrl-C ends it.

    An ignored Ctrl-C, as of a job in the background, stays ignored.
    """
    message = f"{program}: {SENTENCE}\n".encode()
    is_default = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    try:
        if is_default:
            signal.signal(signal.SIGINT, lambda *_: (os.write(2, message), os._exit(INTERRUPTED)))
        imported = import_module(module)
        if is_default:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        getattr(imported, function)()
    except KeyboardInterrupt:
        os.write(2, message)
        sys.exit(INTERRUPTED)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the interpreter ends

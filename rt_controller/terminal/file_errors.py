"""The message for a file that cannot be read or written, where no other code has explained it."""

import errno

from rt_controller.contract.errors import ConfigError, OutputError, RtControllerError

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def explain_file_error(error: OSError) -> RtControllerError:
    """The error to show in place of this one.

    Raises:
        OSError: the same, if it is about no file.
    """
    place = str(error.filename) if error.filename is not None else "A file"
    if error.errno in _NO_ROOM:
        return OutputError(
            f"{place}: expected room to write, found {error.strerror}. Free some space, or choose "
            f"another folder, and start again."
        )
    if error.filename is None:
        raise error
    return ConfigError(
        f"{place}: expected a file or folder that can be read and written, found "
        f"{error.strerror}. Correct its path or its permissions, or name another one."
    )

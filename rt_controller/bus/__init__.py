"""CAN frames to contract types and back; the only room that imports python-can."""

import sys

# python-can imports asammdf for MF4 logs whenever it is installed: half a second that no command
# here needs. A module set to None cannot be imported, which python-can accepts.
if "can" not in sys.modules and "asammdf" not in sys.modules:
    sys.modules["asammdf"] = None  # type: ignore[assignment]
    try:
        import can  # noqa: F401
    finally:
        del sys.modules["asammdf"]

"""Reading DBC files: the message catalogue of this version, or the user's own."""

from pathlib import Path

from cantools.database.can import Database, Message

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.timing import COUNTER_MODULUS

DBC_PATH = Path(__file__).parents[1] / "contract" / "messages.dbc"
FD_DBC_PATH = DBC_PATH.with_name("messages_fd.dbc")
"""the same messages in frames of CAN FD"""
DATA_IDS_ATTRIBUTE = "E2EDataIdList"
"""attribute of a message in the DBC: profile 22"""
DATA_ID_ATTRIBUTE = "E2EDataId"
"""the same of profile 5"""


def dbc_path(is_fd: bool) -> Path:
    """The message catalogue of CAN FD, or of classic CAN."""
    return FD_DBC_PATH if is_fd else DBC_PATH


def read_dbc(
    path: Path,
    encoding: str = "ascii",
    what: str = "the message catalogue as a DBC file",
    remedy: str = "Restore the file that came with this version.",
) -> Database:
    """The database of a DBC file, checked for overlapping signals.

    `what` and `remedy` are for the message: what the file should be, and what to do otherwise.

    Raises:
        ConfigError: the file is missing or is not a DBC.
    """
    database = Database(strict=True)
    try:
        database.add_dbc_string(path.read_text(encoding=encoding))
    except Exception as error:  # parsing and linking raise many types
        raise ConfigError(
            f"{path}: expected {what} in {encoding.upper()}, found {error}. {remedy}"
        ) from error
    return database


def misfit(subject: str, expected: str, found: str) -> ConfigError:
    """The error for a part of the message catalogue that is not as this version needs it."""
    return ConfigError(
        f"message catalogue: expected {subject} {expected}, found {found}. "
        f"Restore the file that came with this version, or adapt rt_controller.bus to the new one."
    )


def data_ids_of(message: Message) -> bytes:
    """The data ids of the end-to-end protection, by counter; their rules: `tools/data_ids.py`.

    Raises:
        ConfigError: they are not 16 hexadecimal bytes.
    """
    attributes = message.dbc.attributes if message.dbc is not None else {}
    text = str(attributes[DATA_IDS_ATTRIBUTE].value) if DATA_IDS_ATTRIBUTE in attributes else ""
    try:
        data_ids = bytes.fromhex(text)
    except ValueError:
        data_ids = b""
    if len(data_ids) != COUNTER_MODULUS:
        raise misfit(
            message.name,
            f"with 16 hexadecimal bytes in {DATA_IDS_ATTRIBUTE} (tools/data_ids.py chooses them)",
            repr(text),
        )
    return data_ids


def data_id_of(message: Message) -> int:
    """The data id of a message of CAN FD.

    Raises:
        ConfigError: it is not a number of 16 bits above 0.
    """
    attributes = message.dbc.attributes if message.dbc is not None else {}
    attribute = attributes.get(DATA_ID_ATTRIBUTE)
    found = 0 if attribute is None else int(attribute.value)
    if not 0 < found <= 0xFFFF:
        raise misfit(message.name, f"with a {DATA_ID_ATTRIBUTE} of 1 to 65535", str(found))
    return found

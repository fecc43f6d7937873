"""Reading DBC files: the message catalogue of this version, or the user's own."""

from pathlib import Path

from cantools.database.can import Database, Message

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.timing import COUNTER_MODULUS

DBC_PATH = Path(__file__).parents[1] / "contract" / "messages.dbc"
DATA_IDS_ATTRIBUTE = "E2EDataIdList"
"""attribute of a message in the DBC"""


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
        f"messages.dbc: expected {subject} {expected}, found {found}. "
        f"Restore the file that came with this version, or adapt rt_controller.bus to the new one."
    )


def data_ids_of(message: Message) -> bytes:
    """The data ids of the end-to-end protection, one for each counter; see `data_ids`.

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
            f"with 16 hexadecimal bytes in {DATA_IDS_ATTRIBUTE} (python -m "
            f"rt_controller.bus.data_ids chooses them)",
            repr(text),
        )
    return data_ids

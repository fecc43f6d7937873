"""The message catalogue of this version, a DBC file."""

from pathlib import Path

from cantools.database.can import Database, Message

DBC_PATH = Path(__file__).parents[1] / "contract" / "messages.dbc"
DATA_IDS_ATTRIBUTE = "E2EDataIdList"
"""attribute of a message in the DBC"""


def read_dbc(path: Path = DBC_PATH, encoding: str = "ascii") -> Database:
    """The database of a DBC file without overlapping signals, with all its attributes.

    The DBC of a car, which may have defects, is read by `mapping.car_file.load_dbc`.
    """
    database = Database(strict=True)
    database.add_dbc_file(path, encoding)
    return database


def data_ids_of(message: Message) -> bytes:
    """The data ids of the end-to-end protection, by counter; their rules: `tools/data_ids.py`."""
    attributes = message.dbc.attributes if message.dbc is not None else {}
    return bytes.fromhex(str(attributes[DATA_IDS_ATTRIBUTE].value))

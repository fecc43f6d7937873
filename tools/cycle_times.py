"""Write the cycle times that follow from the control period into both message catalogues.

Run `python tools/cycle_times.py` after a change of `PERIOD_NS`.
"""

import re

from rt_controller.bus.dbc import DBC_PATH, FD_DBC_PATH
from rt_controller.bus.messages import CATALOGUE


def with_cycle_times(dbc: str) -> str:
    """The text of a DBC with the GenMsgCycleTime of every message of the catalogue.

    A frame of CAN FD has the identifier of the first classic frame of its message.
    """
    for message in CATALOGUE.messages:
        for codec in message.codecs:
            attribute = f'BA_ "GenMsgCycleTime" BO_ {codec.arbitration_id} '
            dbc = re.sub(f"{attribute}[0-9]+;", f"{attribute}{round(message.cycle_ms)};", dbc)
    return dbc


if __name__ == "__main__":
    for path in (DBC_PATH, FD_DBC_PATH):
        path.write_text(with_cycle_times(path.read_text(encoding="ascii")), encoding="ascii")

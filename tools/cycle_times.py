"""Write the cycle times that follow from the control period into the message catalogue.

Run `python tools/cycle_times.py` after a change of `PERIOD_NS`.
"""

import re

from rt_controller.bus.dbc import DBC_PATH
from rt_controller.bus.messages import CATALOGUE


def with_cycle_times(dbc: str) -> str:
    """The text of a DBC with the GenMsgCycleTime of every message of the catalogue."""
    for message in CATALOGUE.messages:
        for codec in message.codecs:
            attribute = f'BA_ "GenMsgCycleTime" BO_ {codec.arbitration_id} '
            dbc = re.sub(f"{attribute}[0-9]+;", f"{attribute}{round(message.cycle_ms)};", dbc)
    return dbc


if __name__ == "__main__":
    text = DBC_PATH.read_text(encoding="ascii")
    DBC_PATH.write_text(with_cycle_times(text), encoding="ascii")

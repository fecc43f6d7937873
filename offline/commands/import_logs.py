"""`offline-import`: a data set from the logs of a real car."""

from functools import partial
from pathlib import Path

from offline.commands.options import JsonFile, Logs
from rt_controller.contract.errors import require_packages
from rt_controller.contract.figures import require_folder, require_writable, write_figures
from rt_controller.terminal.command_line import new_app, run_command

app = new_app(
    "offline-import",
    "Make a data set of recorded logs: CSV, Parquet, MF4, npz, MATLAB, or CAN with a DBC. "
    "Nothing is written unless every log passes the checks. docs/own-data.md has the mapping file.",
    "MAPPING LOGS",
)
main = partial(run_command, app)


@app.default
def import_logs(
    mapping: Path,
    logs: Logs,
    *,
    data: Path | None = None,
    replace: bool = False,
    json_file: JsonFile = None,
) -> None:
    """Convert logs of a real car into a data set to train on, and report what they contain.

    Args:
        mapping: TOML file that maps columns to signals
        logs: log files, or folders of them
        data: folder for the data set; default: none, the logs are only checked
        replace: overwrite an existing data set
    """
    require_packages("offline,logs", ("pandas",), "offline-import")
    require_writable(json_file, inputs=(mapping, *logs))
    require_folder(data, "--data")
    from offline.commands import log_import

    write_figures(json_file, log_import.import_logs(mapping, logs, data, replace=replace))

"""`rt-controller`: drive a car over CAN with a learned model. Options and help; no heavy import."""

import os
from pathlib import Path
from typing import Annotated

# numpy's linear algebra would share long horizons out to threads of its own, and the loop would
# wait for those at their rank. It reads this when numpy is imported: before everything below.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from cyclopts import Parameter

from rt_controller.terminal.command_line import new_app, run_command
from rt_controller.terminal.options import RunOptions, read_config_file

app = new_app(
    "rt-controller",
    "Drive a car over CAN, once a control period, with a model learned from data. The summary "
    "goes to stdout, progress and messages to stderr. Exit codes: 0 ok, 1 internal error, 2 usage, "
    "configuration or model, 3 an optional package is missing, 4 deadlines missed, 5 bus, 6 ended "
    "in a safe stop, 7 the simulated plant failed, 8 the simulated drive missed a limit of its "
    "scenario, 130 ended at once by a second Ctrl-C, or by one while it was loading.",
    "--bus NAME",
)


@app.default
def run(*, options: Annotated[RunOptions, Parameter(name="*")]) -> int:
    """Join the bus, drive the mission, print a summary."""
    from rt_controller.terminal.run import run_at_terminal

    return run_at_terminal(options)


@app.meta.default
def _with_config_file(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    config: Path | None = None,
) -> int:
    """Read settings from a TOML file first; options on the command line override it.

    Parameters
    ----------
    config
        TOML file with the same names as the options, e.g. a table [mpc.tolerance]
    """
    app.config = () if config is None else (read_config_file(config),)
    code = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    return code if isinstance(code, int) else 0


def main() -> None:
    """Entry point of the console script."""
    run_command(app)

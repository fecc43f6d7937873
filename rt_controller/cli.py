"""`rt-controller`: drive a car over CAN with a learned model. Options and help; no heavy import."""

import os
from pathlib import Path
from typing import Annotated

# numpy's linear algebra would share long horizons out to threads of its own, and the loop would
# wait for those at their rank. It reads this when numpy is imported: before everything below.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from cyclopts import App, Parameter

from rt_controller.contract.errors import ConfigError
from rt_controller.terminal.command_line import new_app, run_command
from rt_controller.terminal.options import (
    CheckOptions,
    CompareOptions,
    ExplainOptions,
    GatewayOptions,
    ReplayOptions,
    ReportOptions,
    RunOptions,
    read_config_file,
)

_File = Annotated[Path, Parameter(help="mapping file, see docs/own-car.md")]
_Log = Annotated[Path, Parameter(help="log that --record wrote, with its .journal beside it")]

app = new_app(
    "rt-controller",
    "Drive a car over CAN, once a control period, with a model learned from data. The summary "
    "goes to stdout, progress and messages to stderr. Exit codes: 0 ok, 1 internal error, 2 usage, "
    "configuration or model, 3 an optional package is missing, 4 deadlines missed, 5 bus, 6 ended "
    "in a safe stop, or the vehicle braked by itself, 7 the simulated plant failed, 8 the "
    "simulated drive missed a limit of its scenario, 9 a log or a result file is "
    "incomplete, 130 ended at once by a third Ctrl-C, or by one while it was loading.",
    "--bus NAME",
    {
        "Main options": "bus channel scenario car model controller duration-s record seeds results "
        "html plot json config",
        "Bus": "bitrate bus-option wait-s stay check",
        "Simulated car (--bus virtual)": "plant plant-mapping friction friction-right "
        "transport-delay actuation-delay faults pace",
        "Results": "overwrite ticks quiet verbose max-misses",
    },
)


@app.default
def run(*, options: RunOptions) -> int:
    """Join the bus, drive the mission, print a summary."""
    from rt_controller.terminal.run import run_at_terminal

    return run_at_terminal(options)


signals = App(
    name="signals", help="A car with its own messages: check its mapping file, or translate."
)
app.command(signals)


@signals.command
def check(
    file: _File,
    log: Annotated[
        Path | None, Parameter(help="CAN log to read: .blf, .asc, .log (candump), .trc")
    ] = None,
    *,
    options: CheckOptions | None = None,
) -> int:
    """Say which mapped signals arrive, how often and in which range; 8 if something is wrong."""
    from rt_controller.terminal.signals import check_at_terminal

    return check_at_terminal(file, log, options or CheckOptions())


@signals.command
def gateway(file: _File, *, options: GatewayOptions) -> int:
    """Translate between a car with its own messages and a bus of rt-controller, until Ctrl-C.

    It limits the commands once more, and brakes the car along its path if they stop for 100 ms.
    """
    from rt_controller.terminal.signals import gateway_at_terminal

    return gateway_at_terminal(file, options)


@app.command
def replay(log: _Log, *, options: ReplayOptions | None = None) -> int:
    """Compute the commands of a recorded drive again, from its frames, and list the differences.

    Exit codes: 0 every command is identical, 8 some differ or frames are missing in the log.
    """
    from rt_controller.terminal.explain import explain_at_terminal
    from rt_controller.terminal.replay import replay_at_terminal

    options = options or ReplayOptions()
    if options.tick is None:
        return replay_at_terminal(log, options)
    if options.mcap is not None:
        raise ConfigError(
            "--tick: expected no --mcap beside it, found both. Leave one of them out."
        )
    return explain_at_terminal(log, options)


@app.command
def explain(log: _Log, *, options: ExplainOptions | None = None) -> int:
    """Show one tick of a recorded drive: what happened, why, and what to do.

    Mode, cause and remedy, state, path, command, the checks with their margins, and the times of
    the stages.
    """
    from rt_controller.terminal.explain import explain_at_terminal

    return explain_at_terminal(log, options or ExplainOptions())


@app.command
def compare(*controllers: str, options: CompareOptions | None = None) -> int:
    """Drive the same scenarios with several controllers, in simulated time, on all cores.

    One table has lateral error, speed error, rate of the wheel, jerk and time of a step.
    Needs the extra compare. A drive that failed or was stopped is named below the table;
    exit code 6 if there is no other.

    Parameters
    ----------
    controllers
        mdk-net, mdk-net-small, mdk-net-paper, lti, folders of bundles, stanley, bicycle-mpc, or
        own control laws as MODULE:CLASS or FILE.py:CLASS
    """
    from rt_controller.terminal.compare import compare_at_terminal

    return compare_at_terminal(controllers, options or CompareOptions())


@app.command
def report(
    log: _Log,
    second: Annotated[Path | None, Parameter(help="a log to compare it with")] = None,
    *,
    options: ReportOptions | None = None,
) -> int:
    """Write a page about a recorded drive, or about two side by side: a HTML file of its own.

    What happened, why, and what to do; the drive from above, signals and checks against their
    bounds, times of the steps, faults.
    """
    from rt_controller.terminal.report import report_at_terminal

    logs = [log] if second is None else [log, second]
    return report_at_terminal(logs, options or ReportOptions())


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

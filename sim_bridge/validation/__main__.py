"""`python -m sim_bridge.validation`, the same as `sim-bridge validate`."""

import sys

from cyclopts import App
from rich.console import Console

from rt_controller.contract.errors import RtControllerError
from sim_bridge.validation.command import validate

if __name__ == "__main__":
    app = App(name="python -m sim_bridge.validation")
    app.default(validate)
    try:
        sys.exit(app())
    except RtControllerError as error:
        Console(stderr=True).print(f"[red]validate:[/red] {error}", highlight=False)
        sys.exit(error.exit_code)

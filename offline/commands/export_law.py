"""`offline-export --target c` and `--target fmu`: the control law for other computers."""

from math import inf
from pathlib import Path
from typing import Any, Literal

from offline.commands.options import RUNS
from offline.commands.terminal import STDERR, print_plain, quoted


def export_law(
    target: Literal["c", "fmu"],
    model: Path | None,
    config: Path | None,
    output: Path | None,
    precision: Literal["float", "double"],
    rom_kb: float | None,
    ram_kb: float | None,
) -> dict[str, Any]:
    """Figures of the control law of a bundle, after it was written."""
    from offline.targets.c_source import Limits, export_c
    from offline.targets.fmu import write_fmu
    from rt_controller.model.artifact import find_model, load_bundle
    from rt_controller.terminal.options import read_controller_config

    settings = read_controller_config(config)
    bundle = load_bundle(find_model(model or settings.model))
    if target == "fmu":
        file = output or RUNS / f"{bundle.name}.fmu"
        write_fmu(file, bundle, settings.mpc)
        print_plain(f"{file}: FMU of the controller with the model {bundle.name}")
        return {"fmu": str(file), "model": bundle.name, "model_sha256": bundle.sha256}
    folder = output or RUNS / f"{bundle.name}-c"
    with STDERR.status("driving with the model, for test vectors"):
        figures, lines = export_c(
            bundle, settings, folder, precision, Limits(rom_kb or inf, ram_kb or inf)
        )
    is_tested = figures["test"] is not None
    missing = "" if is_tested else ", which needs a C compiler, make and size: none is here"
    print_plain("\n".join([*lines, f"Test it again{missing}:\n  make -C {quoted(folder)} test"]))
    return figures

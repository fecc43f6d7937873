"""The work of `offline-export --bundle`: an existing bundle gets stored plans, without training."""

from pathlib import Path
from typing import Any

from offline.commands.model_trial import NOT_TRIED, try_model
from offline.commands.terminal import STDOUT
from rt_controller.bundle_checks.plan_check import require_stored_plans, with_plans
from rt_controller.contract.errors import ArtifactError, ConfigError
from rt_controller.model.artifact import CARD_FILE, find_model, load_bundle, save_bundle
from rt_controller.model.validation import require_drivable


def store_plans(model: Path, output: Path | None, is_tried: bool = True) -> dict[str, Any]:
    """Figures of `offline-export --bundle`; the model and its card stay as they are.

    Args:
        model: name of a shipped model, or folder of a bundle.
        output: folder to write; None: that of the bundle.
        is_tried: drive the simulated car with it first.

    Raises:
        ArtifactError: the bundle is damaged, of another format, cannot be driven with, or does not
            hold the simulated car.
        ConfigError: the folder cannot be written.
    """
    folder = find_model(model)
    bundle = load_bundle(folder)
    require_drivable(bundle)
    replaced = ""
    try:
        require_stored_plans(bundle)
    except ArtifactError as error:
        replaced = str(error)
    target = output or folder
    planned = with_plans(bundle)
    trial, trial_figures = try_model(planned) if is_tried else (NOT_TRIED, None)
    try:
        card = (folder / CARD_FILE).read_text("utf-8", errors="replace")
        save_bundle(target, planned, card)
    except OSError as error:
        raise ConfigError(
            f"--bundle {folder}: expected its {CARD_FILE}, and a folder with room for a bundle in "
            f"--output {target}, found {error.filename}: {error.strerror}. "
            f"Name another folder with --output."
        ) from error
    if replaced:
        STDOUT.print(f"its own plans were replaced: {replaced}", soft_wrap=True, markup=False)
    STDOUT.print(
        f"{planned.name} {planned.sha256[:8]}: plans stored; ranges of its training data: "
        f"{'not known' if planned.validity is None else 'in the bundle'}; {trial}. Drive with it:\n"
        f"  rt-controller --bus virtual --model {target}",
        soft_wrap=True,
        markup=False,
        highlight=False,
    )
    return {
        "bundle": str(target),
        "model": planned.name,
        "model_sha256": planned.sha256,
        "plans": 0 if planned.plans is None else len(planned.plans.inputs),
        "trial": None if trial_figures is None else trial_figures._asdict(),
        "replaced_plans": replaced or None,
    }

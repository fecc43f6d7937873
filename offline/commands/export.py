"""`offline-export`: check a model, compare it with baselines, write the bundle."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter, validators

from offline.commands.export_law import export_law
from offline.commands.options import LATEST_RUN, RUNS, JsonFile, require_ready
from offline.commands.terminal import STDERR, STDOUT, print_plain, quoted
from offline.config import PAST_STEPS
from rt_controller.contract.errors import ArtifactError, ConfigError, RtControllerError
from rt_controller.contract.figures import require_folder, require_writable, write_figures
from rt_controller.terminal.command_line import new_app, run_command

if TYPE_CHECKING:
    from offline.data.dataset import Dataset
    from offline.evaluation.comparison import Comparison
    from offline.model.export_checks import ExportFigures
    from rt_controller.model.bundle import Bundle
    from rt_controller.report.table import Fact

app = new_app(
    "offline-export",
    "Make the bundle that rt-controller drives with, or its control law for another computer.",
    "[RUN]",
    {
        "Main options": "run output name baseline data bundle model-trial json target",
        "Control law for another computer": "model config precision rom-kb ram-kb",
    },
)
main = partial(run_command, app)
_Size = Annotated[float, Parameter(validator=validators.Number(gt=0))]


@app.default
def export(
    run: Path = LATEST_RUN,
    *,
    output: Path | None = None,
    name: str | None = None,
    baseline: str | None = None,
    data: Path | None = None,
    bundle: Path | None = None,
    model_trial: Literal["auto", "off"] | None = None,
    target: Literal["bundle", "c", "fmu"] = "bundle",
    model: Path | None = None,
    config: Path | None = None,
    precision: Literal["float", "double"] | None = None,
    rom_kb: _Size | None = None,
    ram_kb: _Size | None = None,
    json_file: JsonFile = None,
) -> None:
    """Export the best model of a run, or a baseline, or an existing bundle in the present format.

    With --target another form of an existing bundle.

    Args:
        run: folder of the run
        output: folder to write; default: bundle in the run, runs/BASELINE, or --bundle; for other
            targets runs/MODEL-c, and the file runs/MODEL.fmu
        name: of the model in summaries and tables; default: mdk-net, or the baseline's
        baseline: export this baseline of the data set instead, for instance lti or
            edmd-bilinear; docs/baselines.md lists them
        data: folder of the data set; default: the one the run was trained on
        bundle: store plans in this bundle, a folder or a shipped name; needs neither run nor data
        model_trial: auto: drive the simulated car with a model of it for eleven simulated seconds,
            and refuse one that does not hold or predict it; off: export any model; default: auto
        target: bundle; c: a folder with the control law of --model in C99; fmu: a file with it as
            an FMU for co-simulation
        model: of the control law, a shipped name or the folder of a bundle; default: mdk-net
        config: file with settings of rt-controller, of which the law has those of mpc
        precision: numbers of the C code, float or double; default: float
        rom_kb: memory of the target for constants and code, in kB of 1024 bytes
        ram_kb: memory of the target for a controller, without its stack
    """
    of_bundle: dict[str, object] = {
        "RUN": None if run == LATEST_RUN else run,
        "--name": name,
        "--baseline": baseline,
        "--data": data,
        "--bundle": bundle,
        "--model-trial": model_trial,
    }
    of_c: dict[str, object] = {"--precision": precision, "--rom-kb": rom_kb, "--ram-kb": ram_kb}
    of_law: dict[str, object] = {"--model": model, "--config": config}
    foreign = {"bundle": of_law | of_c, "c": of_bundle, "fmu": of_bundle | of_c}
    _require_none(foreign[target], target)
    if target != "fmu":
        require_folder(output, "--output")
    if target != "bundle":
        require_writable(json_file)
        figures = export_law(target, model, config, output, precision or "float", rom_kb, ram_kb)
        write_figures(json_file, figures)
        return
    is_tried = model_trial != "off"
    if bundle is not None:
        if baseline is not None or data is not None or run != LATEST_RUN:
            raise ConfigError(
                "--bundle: expected no run, --baseline or --data beside it, found one of them. "
                "Leave it out, or leave out --bundle."
            )
        require_writable(json_file)
        figures = store_plans(bundle, output, is_tried)
    else:
        require_ready(json_file)
        _require_own_name(name)
        if baseline is not None:
            folder = output or RUNS / baseline
            figures = export_baseline(baseline, data, folder, run, is_tried, name)
        else:
            figures = export_run(run, output, data, is_tried, name)
    write_figures(json_file, figures)


def _require_none(others: Mapping[str, object], target: str) -> None:
    """Raise if an option is given that belongs to other targets."""
    given = [option for option, value in others.items() if value is not None]
    if given:
        raise ConfigError(
            f"--target {target}: expected none of {', '.join(others)} beside it, found "
            f"{given[0]}. Leave it out, or choose another --target."
        )


def _require_own_name(name: str | None) -> None:
    from offline.baselines.registry import BASELINES
    from rt_controller.model.artifact import shipped_model

    if name in {*BASELINES, *(folder.name for folder in shipped_model().parent.iterdir())}:
        raise ConfigError(
            f"--name: expected a name that no shipped model and no baseline has, found {name!r}. "
            f"Choose another one."
        )


def export_run(
    path: Path,
    output: Path | None,
    data: Path | None,
    is_tried: bool = True,
    name: str | None = None,
) -> dict[str, Any]:
    """Figures of the best model of a run, after it was exported."""
    from offline.data.dataset import load_dataset
    from offline.training.export import export_checkpoint
    from offline.training.run import load_checkpoint, open_run, training_lock
    from rt_controller.report.table import Fact

    run = open_run(path)
    with training_lock(run):  # only to see that no training is running
        pass
    checkpoint = load_checkpoint(run.best)
    data = data or run.data_folder
    dataset = load_dataset(data)
    first_model = _find_first_model(checkpoint.config.init)
    bundle, checks = export_checkpoint(checkpoint, dataset, first_model=first_model)
    facts = [
        Fact("preset", checkpoint.config.preset),
        Fact(
            "steps",
            f"{load_checkpoint(run.last).step} of {run.config.steps} trained; the best model is "
            f"that after step {checkpoint.step}",
        ),
        # The best checkpoint is written right after its evaluation.
        Fact("validation loss", f"{checkpoint.validation_losses[-1]:.5f}"),
        Fact("seed", str(checkpoint.config.seed)),
        Fact("revision, trained", run.revision),
        *(Fact(f"version of {name}", number) for name, number in run.versions.items()),
    ]
    bundle = bundle if name is None else replace(bundle, name=name)
    return _deliver(bundle, checks, facts, dataset, data, output or run.bundle, is_tried)


def _find_first_model(name: str | None) -> "Bundle | None":
    """The bundle that a training began with; None if there was none, or it is no longer there."""
    from rt_controller.model.artifact import find_model, load_bundle

    try:
        return None if name is None else load_bundle(find_model(name))
    except RtControllerError:
        return None


def export_baseline(
    baseline: str,
    data: Path | None,
    output: Path,
    run: Path,
    is_tried: bool,
    name: str | None = None,
) -> dict[str, Any]:
    """Figures of a baseline, after it was exported.

    Raises:
        ConfigError: no controller can plan with that baseline.
    """
    from offline.baselines.registry import BASELINES, find_baseline, fit
    from offline.data.dataset import exists, load_dataset
    from offline.data.generate import full_folder
    from offline.data.signals import past_names
    from offline.model.export_checks import check_export
    from offline.model.physical_units import choose_selftest
    from offline.training.run import open_run
    from rt_controller.model.lift import Lift

    to_bundle = find_baseline(baseline).to_bundle
    if to_bundle is None:
        drivable = [each for each, kind in BASELINES.items() if kind.to_bundle]
        raise ConfigError(
            f"--baseline {baseline}: expected a model that is linear or bilinear in the lifted "
            f"state, so that a convex QP can plan with it, found another kind. Take one of "
            f"{', '.join(drivable)}."
        )
    full = full_folder()
    folder = data or (full if exists(full) else open_run(run).data_folder)
    STDERR.print(f"data {folder}", soft_wrap=True)
    dataset = load_dataset(folder)
    whole_past = Lift(True, PAST_STEPS, past_names(dataset.schema, dataset.roles))
    with STDERR.status(f"baseline {baseline}"):
        fitted: Any = fit(baseline, dataset)
    bundle = to_bundle(name or baseline, fitted, dataset, choose_selftest(dataset, whole_past))
    checks = check_export(bundle, dataset)
    return _deliver(bundle, checks, fitted.fit_info(), dataset, folder, output, is_tried)


def _deliver(
    bundle: "Bundle",
    checks: "ExportFigures",
    facts: "Sequence[Fact]",
    dataset: "Dataset",
    folder: Path,
    target: Path,
    is_tried: bool,
) -> dict[str, Any]:
    """Evaluate a bundle, write it with its card, and print how to drive with it."""
    from offline.commands.model_trial import NOT_TRIED, try_model
    from offline.data.manifest import Imported, describe_car
    from offline.evaluation.model_card import driven_text, stability_text, write_card
    from offline.evaluation.tables import mse_table
    from rt_controller.bundle_checks.plan_check import with_plans
    from rt_controller.contract.revision import source_revision
    from rt_controller.model.artifact import save_bundle
    from rt_controller.model.validation import find_objection_to_driving
    from rt_controller.report.table import Fact, print_table

    revision = source_revision()
    origin = dataset.origin
    data = (
        f"{origin.episodes} episodes, {dataset.manifest.trajectories} trajectories, "
        f"seed {origin.seed}"
    )
    car = Fact("car", describe_car(origin))
    facts = [*facts, Fact("revision, exported", revision), Fact("data set", data), car]
    comparison = compare_with_plain_baselines(bundle, dataset)
    bundle = with_plans(bundle)
    trial, trial_figures = try_model(bundle) if is_tried else (NOT_TRIED, None)
    facts.append(Fact("trial", trial))
    try:
        save_bundle(target, bundle, write_card(bundle, checks, comparison, facts))
    except OSError as error:
        raise ConfigError(
            f"--output: expected a folder with room for a bundle, found {target}: {error.strerror}."
        ) from error
    print_plain(
        f"{bundle.name}: {stability_text(bundle)}; {driven_text(checks.stability)}; torch/ONNX "
        f"{checks.parity:.1e}\n{car.name}: {car.value}\ntrial: {trial}"
    )
    print_table(mse_table(comparison), STDOUT)
    objection = find_objection_to_driving(bundle)
    drive = f"rt-controller --bus virtual --model {quoted(target)}"
    steps = f"Drive with it:\n  {drive}"
    if isinstance(origin, Imported):
        plant = quoted(f"model:{target}")
        steps = (
            f"A quick look, with the model as the car too:\n  {drive} --plant {plant}\n"
            f"Better, a car that is fitted to the logs, two minutes:\n"
            f"  offline-fit {quoted(folder)} fitted.toml"
        )
    print_plain(steps if objection is None else objection)
    persistence = checks.persistence_over_model.tolist()
    boxes = checks.stability._asdict()
    return {
        "bundle": str(target),
        "model": bundle.name,
        "model_sha256": bundle.sha256,
        "car": car.value,
        "trial": None if trial_figures is None else trial_figures._asdict(),
        "revision": revision,
        "spectral_radius": bundle.spectral_radius,
        "growth_20": bundle.growth(20),
        "growth_80": bundle.growth(80),
        "driven_radius": {name: part.radius for name, part in boxes.items()},
        "driven_growth_80": {name: part.growth for name, part in boxes.items()},
        "persistence_mse_over_model_mse": dict(
            zip(dataset.schema.state_names, persistence, strict=True)
        ),
        "parity": checks.parity,
        "size_bytes": sum(file.stat().st_size for file in target.iterdir()),
        "rows": comparison.figures()["rows"],
    }


def compare_with_plain_baselines(bundle: "Bundle", dataset: "Dataset") -> "Comparison":
    """Errors of a new bundle, linear models and persistence on the test part of the data set.

    A bundle with the name of a baseline replaces it.
    """
    from offline.baselines.registry import PLAIN_BASELINES, open_baselines
    from offline.evaluation.comparison import compare_models
    from offline.evaluation.parts import whole_part
    from offline.evaluation.test_sets import library_set
    from offline.model.bundle_predictor import BundlePredictor

    names = tuple(name for name in PLAIN_BASELINES if name != bundle.name)
    baselines = open_baselines(names, dataset, [bundle], is_required=False)
    models = {bundle.name: BundlePredictor(bundle)}
    library = whole_part(library_set(dataset))
    return compare_models(models, baselines, [library], dataset.schema)


def store_plans(model: Path, output: Path | None, is_tried: bool) -> dict[str, Any]:
    """Figures of an existing bundle that got stored plans; model and card stay as they are.

    Args:
        model: name of a shipped model, or folder of a bundle.
        output: folder to write; None: that of the bundle.
        is_tried: drive the simulated car with it first.

    Raises:
        ArtifactError: the bundle is damaged, of another format, cannot be driven with, or does not
            hold the simulated car.
        ConfigError: the folder cannot be written.
    """
    from offline.commands.model_trial import NOT_TRIED, try_model
    from rt_controller.bundle_checks.plan_check import require_stored_plans, with_plans
    from rt_controller.model.artifact import CARD_FILE, find_model, load_bundle, save_bundle
    from rt_controller.model.validation import require_drivable

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
        print_plain(f"its own plans were replaced: {replaced}")
    print_plain(
        f"{planned.name} {planned.sha256[:8]}: plans stored; ranges of its training data: "
        f"{'not known' if planned.validity is None else 'in the bundle'}; {trial}. Drive with it:\n"
        f"  rt-controller --bus virtual --model {quoted(target)}"
    )
    return {
        "bundle": str(target),
        "model": planned.name,
        "model_sha256": planned.sha256,
        "plans": 0 if planned.plans is None else len(planned.plans.inputs),
        "trial": None if trial_figures is None else trial_figures._asdict(),
        "replaced_plans": replaced or None,
    }

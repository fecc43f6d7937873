"""Table II and figure 3: open-loop predictions of the shipped models and of linear ones."""

from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.paper.elements import LTI, MDK_NET, MSE, Element, beside, mse_ratios
from benchmarks.paper.training import LARGEST_STEER_DEG, STEPS, finished_run, open_data
from offline.baselines.registry import open_baselines
from offline.evaluation.bootstrap import Estimate, mean_draws
from offline.evaluation.lane_change import drive_lane_change
from offline.evaluation.metrics import absolute_errors, mean_names, ratios_of, state_units
from offline.evaluation.page import lane_change_plot
from offline.evaluation.predictor import Predictor, predict_trajectories
from offline.evaluation.test_sets import TestSet, library_set
from offline.model.bundle_predictor import BundlePredictor
from offline.training.export import export_checkpoint
from offline.training.run import load_checkpoint
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.bundle import Bundle
from rt_controller.report.page import Plot

MODELS = ("mdk-net", "mdk-net-paper", "lti")
"""shipped; of these only `lti` was fitted to the wheel angles of the paper"""
BASELINES = ("lti-per-curvature", "lti-scheduled-delays", "persistence")
"""fitted here; the first is the LTI model of the paper: one for each curvature"""
OF_PAPER = {"mdk-net-paper": MDK_NET, "lti-per-curvature": LTI}
PRESET = "paper"
TRAINED_HERE = f"preset {PRESET}, {STEPS:,} steps"
RATIOS = (
    ("lti-per-curvature", "mdk-net-paper"),
    ("lti-per-curvature", TRAINED_HERE),
    ("lti-per-curvature", "mdk-net"),
    ("lti-scheduled-delays", "mdk-net"),
)
"""models of the numerator and the denominator; the first are those of the paper"""
COLUMNS = state_units(VEHICLE)
KEYS = ("vx_kmh", "vy_kmh", "yaw_rate_degps", "ds_m", "ey_m", "epsi_deg")
"""names of the states with the units of `COLUMNS`"""


@cache
def open_models() -> dict[str, Predictor]:
    """Shipped models, then baselines."""
    bundles = {name: Bundle.load(name) for name in MODELS}
    fitted = open_baselines(BASELINES, open_data(), list(bundles.values()), is_required=True)
    return {name: BundlePredictor(bundle) for name, bundle in bundles.items()} | fitted


def table_2(folder: Path) -> Element:
    """MSE over 80 steps of 2,400 trajectories. Paper: tab:mse_comparison.

    `folder` is that of `finished_run`.
    """
    test, models = library_set(open_data()), dict(open_models())
    checkpoint = load_checkpoint(finished_run(PRESET, folder).best)
    bundle, _ = export_checkpoint(checkpoint, open_data())
    models[TRAINED_HERE] = BundlePredictor(bundle)
    errors = {name: _errors(model, test) for name, model in models.items()}
    mse, ratios = {}, {}
    for name, each in errors.items():
        keys = (f"{key}_squared" for key in KEYS)
        mse[name] = dict(zip(keys, each[0].tolist(), strict=True))
    for name, of_paper in OF_PAPER.items():
        mse[name] = beside(mse[name], dict(zip(mse[name], MSE[of_paper], strict=True)))
    for above, below in RATIOS:
        found = np.transpose(ratios_of(errors[above], errors[below], COLUMNS)).tolist()
        names = [*(column.name for column in COLUMNS), *mean_names(COLUMNS)]
        by_name = {name: Estimate(*row)._asdict() for name, row in zip(names, found, strict=True)}
        ratios[f"{above} / {below}"] = {state: by_name[state] for state in mse_ratios()}
    first = next(iter(ratios))
    ratios[first] = beside(ratios[first], mse_ratios())
    means = {name: row["geometric_mean"] for name, row in ratios.items()}
    return Element(
        "Table II",
        f"Errors of open-loop predictions over 80 steps, here on {len(test.trajectories.x):,} "
        f"trajectories with wheel angles up to {LARGEST_STEER_DEG:g} deg, as in the paper, in "
        "another car: errors are not comparable, ratios only in kind. mdk-net and "
        f"mdk-net-paper were trained with larger angles, {TRAINED_HERE} with these. The printed "
        "error of the LTI model in v_x, 83 km/h, is more than the full brake could cause in 2 s.",
        {
            f"MSE of {name}, geometric mean": mean if "here" in mean else {"here": mean}
            for name, mean in means.items()
        },
        {"paper_mse": mse, "paper_mse_ratios": ratios},
    )


def _errors(model: Predictor, test: TestSet) -> Array:
    """Draws (1 + R, n) of the mean squared errors."""
    squared = np.square(absolute_errors(model, test, COLUMNS)).mean(axis=1)
    return mean_draws(squared, test.trajectories.episode)


def figure_3() -> Element:
    """The double lane change, open loop. Paper: fig:trajectory_comparison."""
    driven, rows, predicted = drive_lane_change(), {}, {}
    for name, model in open_models().items():
        predicted[name] = predict_trajectories(model, driven.windows)
        errors = (predicted[name] - driven.windows.x)[:, 1:] * [each.per_si for each in COLUMNS]
        rms = np.sqrt(np.mean(np.square(errors), axis=(0, 1)))
        rows[name] = dict(zip(KEYS, rms.tolist(), strict=True))
    mdk_net, lti = OF_PAPER
    shown = {name: predicted[name] for name in (*MODELS, lti)}
    return Element(
        "Figure 3",
        f"Double lane change, open loop: the same inputs, {driven.description}. The models start "
        "from the measured state every 2 s. The paper prints no numbers.",
        {
            f"RMS error of the lateral position, {lti} / {mdk_net}": {
                "here": rows[lti]["ey_m"] / rows[mdk_net]["ey_m"]
            }
        },
        {"paper_open_loop_rms": rows},
        {"figure-3": Plot(lane_change_plot(driven, shown, MODELS, (lti,)), "Dotted: new start.")},
    )

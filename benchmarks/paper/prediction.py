"""Table II and figure 3: open-loop predictions of the shipped models and of linear ones."""

from functools import cache

import numpy as np

from benchmarks.paper.elements import LTI, MDK_NET, MSE, Element, beside, mse_ratios
from offline.baselines.registry import open_baselines
from offline.data.dataset import Dataset, cache_folder, exists, load_dataset
from offline.data.generate import make_dataset, simulated_origin
from offline.data.manifest import PARTS
from offline.data.recipe import Recipe
from offline.evaluation.lane_change import drive_lane_change
from offline.evaluation.metrics import TrajectoryErrors, errors_on, ratios_of, state_units
from offline.evaluation.page import lane_change_plot
from offline.evaluation.predictor import Predictor, predict_trajectories
from offline.evaluation.test_sets import TestSet, library_set
from offline.model.bundle_predictor import BundlePredictor
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.bundle import Bundle
from rt_controller.report.page import Plot

MODELS = ("mdk-net", "mdk-net-paper", "lti")
"""shipped; of these only `lti` was fitted to the wheel angles of the paper"""
BASELINES = ("lti-per-curvature", "lti-scheduled-delays", "persistence")
"""fitted here; the first is the LTI model of the paper: one for each curvature"""
OF_PAPER = {"mdk-net-paper": MDK_NET, "lti-per-curvature": LTI}
RATIOS = {
    "lti-per-curvature / mdk-net-paper": ("lti-per-curvature", "mdk-net-paper"),
    "lti-per-curvature / mdk-net": ("lti-per-curvature", "mdk-net"),
    "lti-scheduled-delays / mdk-net": ("lti-scheduled-delays", "mdk-net"),
}
"""by name; the first is the one of the paper"""

LARGEST_STEER_DEG = 40.0
SEED = 2_503
"""of no other data set: no model was trained on these episodes"""
EPISODES = {"train": 1_200, "validation": 200, "test": 600}
"""600 have 480 slices of each curvature; the paper has 7,000 in all"""
COLUMNS = state_units(VEHICLE)


@cache
def open_data() -> Dataset:
    """The data set with the bounds of the paper, from the cache or made now on all cores."""
    recipe = Recipe(largest_steer_deg=LARGEST_STEER_DEG)
    origin = simulated_origin(recipe, sum(EPISODES.values()), SEED)
    folder = cache_folder(origin)
    if exists(folder):
        return load_dataset(folder)
    part = np.repeat(np.arange(len(PARTS), dtype=np.int8), [EPISODES[name] for name in PARTS])
    return make_dataset(folder, origin, part)


@cache
def open_models() -> dict[str, Predictor]:
    """Shipped models, then baselines."""
    bundles = {name: Bundle.load(name) for name in MODELS}
    fitted = open_baselines(BASELINES, open_data(), list(bundles.values()), is_required=True)
    return {name: BundlePredictor(bundle) for name, bundle in bundles.items()} | fitted


def table_2() -> Element:
    """MSE over 80 steps of 2,400 trajectories. Paper: tab:mse_comparison."""
    test = library_set(open_data())
    errors = {name: _errors(model, test) for name, model in open_models().items()}
    keys = [column.squared_key for column in COLUMNS]
    mse = {
        name: dict(zip(keys, each.mean_draws[0].tolist(), strict=True))
        for name, each in errors.items()
    }
    for name, of_paper in OF_PAPER.items():
        mse[name] = beside(mse[name], dict(zip(keys, MSE[of_paper], strict=True)))
    ratios = {}
    for name, (above, below) in RATIOS.items():
        found = ratios_of(errors[above].mean_draws, errors[below].mean_draws, COLUMNS)
        ratios[name] = {state: found[state] for state in mse_ratios()}
    first, second, _ = ratios
    ratios[first] = beside(ratios[first], mse_ratios())
    return Element(
        "Table II",
        "errors of open-loop predictions over 80 steps",
        f"{test.count}, wheel angles up to {LARGEST_STEER_DEG:g} deg as in the paper, in another "
        "car: errors are not comparable, ratios only in kind. The printed error of the LTI model "
        "in v_x, 83 km/h, is more than the full brake could cause in 2 s.",
        {
            f"MSE of {first}, geometric mean": ratios[first]["geometric_mean"],
            f"MSE of {second}, geometric mean": {"here": ratios[second]["geometric_mean"]},
        },
        {"paper_mse": mse, "paper_mse_ratios": ratios},
    )


def _errors(model: Predictor, test: TestSet) -> TrajectoryErrors:
    return errors_on(model, test, COLUMNS)[1]


def figure_3() -> Element:
    """The double lane change, open loop. Paper: fig:trajectory_comparison."""
    driven, rows, predicted = drive_lane_change(), {}, {}
    for name, model in open_models().items():
        predicted[name] = predict_trajectories(model, driven.windows)
        errors = (predicted[name] - driven.windows.x)[:, 1:] * [each.per_si for each in COLUMNS]
        rms = np.sqrt(np.mean(np.square(errors), axis=(0, 1)))
        rows[name] = dict(zip((each.key for each in COLUMNS), rms.tolist(), strict=True))
    mdk_net, lti = OF_PAPER
    shown = {name: predicted[name] for name in (*MODELS, lti)}
    return Element(
        "Figure 3",
        "double lane change, open loop: states of car and models under the same inputs",
        f"{driven.description}. The models start from the measured state every 2 s. The paper "
        "prints no numbers.",
        {
            f"RMS error of e_y, {lti} / {mdk_net}": {
                "here": rows[lti]["ey_m"] / rows[mdk_net]["ey_m"]
            }
        },
        {"paper_open_loop_rms": rows},
        {"figure-3": Plot(lane_change_plot(driven, shown, MODELS, (lti,)), "Dotted: new start.")},
    )

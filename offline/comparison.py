"""A new bundle beside the plain rivals on the test part of its data: for its card, and a table."""

from offline.dataset import Dataset
from offline.evaluation_sheets import mse_sheet
from offline.judgement import Judgement, judge
from offline.predictor import BundlePredictor
from offline.rivals import PLAIN_RIVALS, open_rivals
from offline.sheet import print_sheet
from offline.test_sets import library_set
from rt_controller.contract.artifact import Bundle


def compare(bundle: Bundle, dataset: Dataset) -> Judgement:
    """Errors of the bundle, linear models and persistence on the test part of the data set.

    A bundle that is one of the rivals takes its place.
    """
    names = tuple(name for name in PLAIN_RIVALS if name != bundle.name)
    rivals = open_rivals(names, dataset, [bundle], insisted=False)
    models = {bundle.name: BundlePredictor(bundle)}
    return judge(models, rivals, [library_set(dataset)], dataset.schema)


def print_pooled(judgement: Judgement) -> None:
    """The table over all roads."""
    print_sheet(mse_sheet(judgement, judgement.sets[0]))

"""Options that several commands have, with their help texts, and what is checked at the start.

The commands import everything heavy inside their functions, so that `--help` and refused options
need neither numpy nor torch.
"""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from offline.config import TrainingConfig
from offline.experiments.backend import Backend
from rt_controller.contract.errors import require_packages
from rt_controller.contract.figures import require_writable

RUNS = Path("runs")
LATEST_RUN = RUNS / "latest"
OFFLINE_PACKAGES = ("torch", "onnx", "onnxscript", "joblib", "onnxruntime")
THIS_MACHINE = Backend()

Config = Annotated[
    TrainingConfig | None, Parameter(name="*", negative_none="no-", consume_multiple=True)
]
Logs = Annotated[list[Path], Parameter(consume_multiple=True, negative="")]
JsonFile = Annotated[Path | None, Parameter(name="--json", help="write the figures to this file")]
DataFolder = Annotated[
    Path | None,
    Parameter(help="folder of the data set; default: one in the cache, which is printed"),
]

TRAINING_GROUPS = {
    "Main options": "VARIANTS preset steps seed seeds only folder data resume runs init json",
    "Data": "episodes data-seed windows rare-share near-roads mirror noise",
    "Optimisation": "batch optimizer learning-rate matrix-rate operator-rate rate-schedule "
    "patience evaluate-every gradient-clip best-rule",
    "Loss": "objective horizon-start horizon-growth forgetting weight-single-step "
    "weight-multi-step weight-stability weight-regularisation decay-encoder decay-operator "
    "operator-prior stability through-last-step target-samples",
    "Model": "activation hidden latents latents-start constant-observable lift-exogenous products "
    "history-steps separate-motion bilinear-rank "
    "saturating-gains drift-rank bilinear-follows",
    "Machine and campaign": "threads device backend address jobs lists",
}
"""options of offline-train, and of offline-ablate, which trains many models, by group"""


def require_ready(json_file: Path | None) -> None:
    """Raise before the work starts what would otherwise be raised after it.

    Raises:
        MissingExtraError: a package of the extra `offline` is not installed.
        ConfigError: the JSON file cannot be written.
    """
    require_packages("offline", OFFLINE_PACKAGES, "learning")
    require_writable(json_file)

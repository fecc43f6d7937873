"""Options that several commands have, with their help texts, and what is checked at the start.

The commands import everything heavy inside their functions, so that `--help` and refused options
need neither numpy nor torch.
"""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from offline.config import TrainingConfig
from rt_controller.contract.errors import require_packages
from rt_controller.contract.figures import require_writable

RUNS = Path("runs")
LATEST_RUN = RUNS / "latest"
OFFLINE_PACKAGES = ("torch", "onnx", "onnxscript", "joblib", "onnxruntime")

Config = Annotated[
    TrainingConfig | None, Parameter(name="*", negative_none="no-", consume_multiple=True)
]
Several = Parameter(consume_multiple=True, negative="")
Logs = Annotated[list[Path], Several]
JsonFile = Annotated[Path | None, Parameter(name="--json", help="write the figures to this file")]
DataFolder = Annotated[
    Path | None,
    Parameter(help="folder of the data set; default: one in the cache, which is printed"),
]


def require_ready(json_file: Path | None) -> None:
    """Raise before the work starts what would otherwise be raised after it.

    Raises:
        MissingExtraError: a package of the extra `offline` is not installed.
        ConfigError: the JSON file cannot be written.
    """
    require_packages("offline", OFFLINE_PACKAGES, "learning")
    require_writable(json_file)

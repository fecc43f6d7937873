"""Options that several commands have, with their help texts, and what is checked at the start."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from offline.config import TrainingConfig
from offline.data.variation import Variation
from rt_controller.contract.errors import require_packages
from rt_controller.contract.figures import require_writable

RUNS = Path("runs")
LATEST_RUN = RUNS / "latest"
OFFLINE_PACKAGES = ("torch", "onnx", "onnxscript", "joblib", "onnxruntime")

Config = Annotated[
    TrainingConfig | None, Parameter(name="*", negative_none="no-", consume_multiple=True)
]
Ranges = Annotated[
    Variation | None,
    Parameter(
        name="*",
        group="Road, wind, load and tyres",
        negative_none="no-",
        negative_iterable="",
    ),
]
Names = Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")]
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


@Parameter(name="*")
@dataclass(frozen=True, slots=True)
class EvaluationOptions:
    """Models, data, baselines and test sets of an evaluation."""

    model: Annotated[
        list[Path] | None,
        Parameter(
            consume_multiple=True,
            negative="",
            help="shipped models by name, or folders of bundles (./lti if a folder has the name of "
            "a shipped model); default: that of the latest run",
        ),
    ] = None
    data: Annotated[
        Path | None,
        Parameter(
            help="folder of a data set; default: the full one if it is in the cache, otherwise one "
            "that a model, or the latest run, was trained on. A data set whose test episodes a "
            "model may have been trained on is refused"
        ),
    ] = None
    baselines: Annotated[
        Names,
        Parameter(
            help='names of baselines, "all" or "none"; default: linear models, persistence, and '
            "the paper's network. A baseline that is not in the cache is fitted first",
        ),
    ] = None
    refit: Annotated[
        bool,
        Parameter(
            negative="",
            help="fit the baselines again, also those in the cache: after a change of their code",
        ),
    ] = False
    sets: Annotated[
        Names,
        Parameter(
            help="library, new-roads, bends, robustness, varied, noise, sliding, fast, braking, "
            "friction, mass; default: all of them",
        ),
    ] = None
    noise: Annotated[
        list[float] | None,
        Parameter(
            consume_multiple=True,
            negative="",
            help="levels of the test sets with measurement noise, 1 for 0.03 m/s, 0.1 deg/s, "
            "0.02 m and 0.1 deg; default: 1 3",
        ),
    ] = None

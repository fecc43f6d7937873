"""How a training of a campaign ended, and the file that says so."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from offline.campaign.score import Score
from offline.campaign.whole_file import write_json
from rt_controller.contract.errors import ArtifactError

FILE = "result.json"

Ending = Literal["finished", "diverged", "refused", "pruned"]


@dataclass(frozen=True, slots=True)
class Result:
    """How a training ended."""

    ending: Ending
    """diverged: the loss is no number; refused: the best model may not be exported; pruned: not
    worth going on with"""
    step: int
    """of the model that was scored, or that was the last"""
    training_cpu_s: float
    """of all threads together: what else the machine was doing does not count"""
    reason: str = ""
    """why there is no score"""
    score: Score | None = None
    """on the validation part"""
    spectral_radius: float | None = None
    """of A"""
    n_parameters: int | None = None
    """numbers that were learned: of the encoder and of all matrices"""


def keep_result(folder: Path, result: Result) -> None:
    """Write the result of the training in that folder."""
    write_json(folder / FILE, asdict(result))


def read_result(folder: Path) -> Result | None:
    """The result of the training in that folder, None if it has not ended.

    Raises:
        ArtifactError: the file is not one of this program.
    """
    file = folder / FILE
    if not file.exists():
        return None
    try:
        fields = dict(json.loads(file.read_text(encoding="utf-8")))
        score = fields.pop("score")
        if score is not None:
            score = Score(tuple(score["ratios"]), score["geometric_mean"])
        return Result(**fields, score=score)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ArtifactError(
            f"{file}: expected the result of a training, found something else ({error}). Delete "
            f"it; the training goes on from its checkpoint."
        ) from error

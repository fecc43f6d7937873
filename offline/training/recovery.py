"""What a training does when its numbers are no longer finite."""

import math
from dataclasses import dataclass

import numpy as np

from offline.data.dataset import Dataset
from offline.data.signals import Scaling
from offline.training.run_folder import RunFolder, cut_history
from offline.training.state import TrainingState, load_checkpoint
from rt_controller.contract.errors import RtControllerError

MOST_SKIPPED_IN_A_ROW = 50
"""steps that are not taken because the gradient is not finite"""
MOST_RECOVERIES = 6
"""then the learning rate is 1/64 of the configured one"""


class TrainingDivergedError(RtControllerError):
    """The loss or its gradient is no longer finite, at any learning rate that was tried."""


@dataclass(frozen=True, slots=True)
class Recovery:
    """Return to the last evaluation, with half the learning rate from there on."""

    run: RunFolder
    dataset: Dataset
    scaling: Scaling

    def is_needed(self, state: TrainingState, validation_loss: float = 0.0) -> bool:
        """True after a recovery from a loss, or many gradients in a row, that are not finite.

        `validation_loss` is that of an evaluation that is not yet part of `state`.

        Raises:
            TrainingDivergedError: there was no evaluation yet, or the rate was halved
                `MOST_RECOVERIES` times. The message names the largest step in the data.
        """
        if not math.isfinite(state.losses.total.item()):
            what = "the loss"
        elif state.skipped_in_a_row > MOST_SKIPPED_IN_A_ROW:
            what = "the gradient"
        elif not math.isfinite(validation_loss):
            what = "the validation loss"
        else:
            return False
        run, step, rate_share = self.run, state.step, 0.5 * state.rate_share
        if not run.last.exists() or rate_share < 0.5**MOST_RECOVERIES:
            rate = run.config.learning_rate
            raise TrainingDivergedError(
                f"{run.path}: expected {what} to be finite, found that it is not at step {step}, "
                f"also with {state.rate_share:g} of the learning rate of {rate:g}. "
                f"{largest_step(self.dataset, self.scaling)} If that is an error of the recording, "
                f"leave the episode out or mend the log; otherwise train again with "
                f"--learning-rate {rate * rate_share:.1g}. The best checkpoint so far is kept."
            )
        state.restore(load_checkpoint(run.last))
        state.rate_share = rate_share
        state.learning_rate *= 0.5
        cut_history(run, state.step)
        return True


def largest_step(dataset: Dataset, scaling: Scaling) -> str:
    """A sentence about the largest change of a recorded signal from one sample to the next."""
    recording = dataset.recording
    states = recording.x.shape[1]
    signals = np.concatenate(
        [recording.x / scaling.x_scale[:states], recording.u / scaling.u_scale], axis=1
    )
    change = np.abs(np.diff(signals, axis=0))
    change[recording.first[1:] - 1] = 0.0
    row, column = np.unravel_index(int(np.argmax(change)), change.shape)
    episode = int(np.searchsorted(recording.first, row, side="right")) - 1
    name = (dataset.schema.state_names[:states] + dataset.schema.input_names)[column]
    return (
        f"The largest change within one period is that of {name} after sample "
        f"{row - recording.first[episode]} of episode {episode}: {change[row, column]:.3g} times "
        f"its scale."
    )

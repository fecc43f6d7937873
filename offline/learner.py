"""What a training run carries from step to step: the model, its optimiser and its dice.

One mutable thing in one place; `train` reads on top of it like the algorithm on paper.
"""

import math
from typing import Any

import numpy as np
import torch

from offline.batch import Batch
from offline.checkpoint import Checkpoint
from offline.config import TrainingConfig
from offline.horizon_loss import horizon_loss, horizon_of_step, log_error, state_errors
from offline.losses import Losses, draw_times, total_loss
from offline.model import MdkNet, Sizes
from offline.projection import project
from offline.scaling import Scaling
from offline.schedule import cosine_rate, is_evaluated
from offline.source import Source
from rt_controller.contract.errors import ConfigError

EVALUATION_CHUNK = 500


def find_device(name: str) -> torch.device:
    """The device of that name, if this machine has it and torch can compute there.

    Raises:
        ConfigError: it has not, or there is no such name.
    """
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise ConfigError(
            f"--device {name}: expected a device that torch can compute on here, found none "
            f"({reason}). Take cpu, or install a torch built for it."
        ) from error
    return device


PROJECTION_STEPS = 10
"""between two projections of the operator: an eigenvalue does not get far in so few"""


class Learner:
    """A model being trained on scaled trajectories."""

    def __init__(
        self, config: TrainingConfig, sizes: Sizes, scaling: Scaling, data_sha256: str
    ) -> None:
        torch.manual_seed(config.seed)
        self.config = config
        self.scaling = scaling
        self.data_sha256 = data_sha256
        self.device = find_device(config.device)
        self.model = MdkNet(config, sizes).to(self.device)
        self.optimizer = _adam(self.model, config)
        self.dice = torch.Generator().manual_seed(config.seed)
        self.step = 0
        self.skipped = 0
        self.validation_losses: list[float] = []
        self._sums = torch.zeros(len(Losses._fields), dtype=torch.float64)
        self._count = 0

    @property
    def learning_rate(self) -> float:
        return float(self.optimizer.param_groups[0]["lr"])

    def set_learning_rate(self) -> None:
        """The rate of this step, where it follows the steps and not the validation loss."""
        if self.config.rate_schedule == "cosine":
            rate = cosine_rate(self.step, self.config.steps, self.config.learning_rate)
            self._change_learning_rate(rate)

    def halve_learning_rate(self) -> None:
        self._change_learning_rate(0.5 * self.learning_rate)

    def losses_on_random_batch(self, source: Source) -> Losses:
        """Losses on trajectories drawn with replacement."""
        config = self.config
        batch = source.draw(config.batch, self.dice).to(self.device)
        if config.objective == "horizon":
            batch = batch.shorten(horizon_of_step(self.step, config.steps, config, batch.steps))
        times = None
        if config.target_samples is not None:
            times = draw_times(batch.steps, config.target_samples, self.dice)
        return self._objective(self.model, config, batch, times)

    def update(self, losses: Losses) -> bool:
        """Whether a gradient step was taken: not if the gradient is not finite."""
        self.optimizer.zero_grad()
        losses.total.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(
            self.model.parameters(), self.config.gradient_clip or math.inf
        )
        is_taken = bool(torch.isfinite(norm))
        if is_taken:
            self.optimizer.step()
            self._bound_spectrum()
        else:
            self.skipped += 1
        self._sums += torch.stack(losses).detach().cpu().double()
        self._count += 1
        self.step += 1
        return is_taken

    def take_mean_losses(self) -> list[float]:
        """Training losses since the last call, averaged, in the order of `Losses`."""
        means = (self._sums / max(self._count, 1)).tolist()
        self._sums, self._count = torch.zeros_like(self._sums), 0
        return [float(mean) for mean in means]

    def evaluate(self, batch: Batch) -> list[float]:
        """Losses over all trajectories, every target encoded, in the order of `Losses`."""
        count = batch.x.shape[1]
        sums = torch.zeros(len(Losses._fields), dtype=torch.float64)
        errors = torch.zeros(self.model.sizes.states, dtype=torch.float64)
        is_horizon = self.config.objective == "horizon"
        with torch.no_grad():
            for first in range(0, count, EVALUATION_CHUNK):
                rows = slice(first, first + EVALUATION_CHUNK)
                part = Batch(*(series[:, rows] for series in batch)).to(self.device)
                share = part.x.shape[1] / count
                losses = self._objective(self.model, self.config, part, None)
                sums += share * torch.stack(losses).cpu().double()
                if is_horizon:
                    errors += share * state_errors(self.model, part).cpu().double()
        means = Losses(*(float(mean) for mean in sums))  # type: ignore[arg-type]
        if is_horizon:  # the logarithm of a mean, not the mean of logarithms
            exact = float(log_error(errors))
            more = self.config.weight_multi_step * (exact - float(means.multi_step))
            means = means._replace(total=means.total + more, multi_step=exact)  # type: ignore[arg-type]
        return [float(mean) for mean in means]

    def spectral_radius(self) -> float:
        """Largest magnitude of an eigenvalue of A, in float64; not a number where A is none."""
        A = self.model.operator().A.detach().double().cpu().numpy()
        if not np.all(np.isfinite(A)):
            return math.nan
        return float(np.abs(np.linalg.eigvals(A)).max())

    def to_checkpoint(self) -> Checkpoint:
        """Everything that `restore` needs to go on bit by bit."""
        return Checkpoint(
            step=self.step,
            config=self.config,
            scaling=self.scaling,
            data_sha256=self.data_sha256,
            model=self.model.state_dict(),
            optimizer=self.optimizer.state_dict(),
            batch_rng=self.dice.get_state(),
            torch_rng=torch.get_rng_state(),
            validation_losses=self.validation_losses,
            running_sums=self._sums.tolist(),
            running_count=self._count,
            skipped=self.skipped,
        )

    def restore(self, checkpoint: Checkpoint) -> None:
        """Take up the state of a checkpoint; the configuration stays one's own."""
        self.model.load_state_dict(checkpoint.model)
        self.optimizer.load_state_dict(dict(checkpoint.optimizer))
        self.dice.set_state(checkpoint.batch_rng)
        torch.set_rng_state(checkpoint.torch_rng)
        self.step = checkpoint.step
        self.skipped = checkpoint.skipped
        self.validation_losses = list(checkpoint.validation_losses)
        self._sums = torch.tensor(checkpoint.running_sums, dtype=torch.float64)
        self._count = checkpoint.running_count

    def _objective(
        self,
        model: MdkNet,
        config: TrainingConfig,
        batch: Batch,
        times: torch.Tensor | None,
    ) -> Losses:
        objective = horizon_loss if config.objective == "horizon" else total_loss
        return objective(model, config, batch, times)

    def _change_learning_rate(self, rate: float) -> None:
        for group in self.optimizer.param_groups:
            group["lr"] = group["share"] * rate

    def _bound_spectrum(self) -> None:
        config = self.config
        # A model that is about to be judged, and perhaps kept, is bounded too.
        is_due = self.step % PROJECTION_STEPS == 0 or is_evaluated(self.step + 1, config)
        if config.stability == "projection" and is_due:
            project(self.model)


def _adam(model: MdkNet, config: TrainingConfig) -> torch.optim.Adam:
    """The optimiser; its first group has the rate, A a share of it."""
    rest = [p for name, p in model.named_parameters() if name != "A_rows"]
    groups: list[dict[str, Any]] = [
        {"params": rest, "share": 1.0},
        {"params": [model.A_rows], "share": config.operator_rate},
    ]
    for group in groups:
        group["lr"] = group["share"] * config.learning_rate
    return torch.optim.Adam(groups)

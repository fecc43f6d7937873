"""What a training run carries from step to step: the model, its optimiser and its dice.

One mutable thing in one place; `train` reads on top of it like the algorithm on paper.
"""

import math

import numpy as np
import torch
from torch import Tensor

from offline.checkpoint import Checkpoint
from offline.config import TrainingConfig
from offline.dataset import Trajectories
from offline.losses import Losses, draw_times, total_loss
from offline.model import MdkNet
from offline.scaling import Scaling

EVALUATION_CHUNK = 500


class Learner:
    """A model being trained on scaled trajectories."""

    def __init__(self, config: TrainingConfig, scaling: Scaling, data_sha256: str) -> None:
        torch.manual_seed(config.seed)
        self.config = config
        self.scaling = scaling
        self.data_sha256 = data_sha256
        self.model = MdkNet(config)
        self.optimizer = torch.optim.Adam(self.model.parameters(), lr=config.learning_rate)
        self.dice = torch.Generator().manual_seed(config.seed)
        self.step = 0
        self.skipped = 0
        self.validation_losses: list[float] = []
        self._sums = [0.0] * len(Losses._fields)
        self._count = 0

    @property
    def learning_rate(self) -> float:
        return float(self.optimizer.param_groups[0]["lr"])

    def halve_learning_rate(self) -> None:
        self.optimizer.param_groups[0]["lr"] *= 0.5

    def losses_on_random_batch(self, x: Tensor, u: Tensor) -> Losses:
        """Losses on trajectories drawn with replacement from x (N, K+1, 6), u (N, K, 4)."""
        chosen = torch.randint(x.shape[0], (self.config.batch,), generator=self.dice)
        times = None
        if self.config.target_samples is not None:
            times = draw_times(u.shape[1], self.config.target_samples, self.dice)
        return total_loss(
            self.model, self.config, _time_first(x[chosen]), _time_first(u[chosen]), times
        )

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
        else:
            self.skipped += 1
        self._sums = [total + loss.item() for total, loss in zip(self._sums, losses, strict=True)]
        self._count += 1
        self.step += 1
        return is_taken

    def take_mean_losses(self) -> list[float]:
        """Training losses since the last call, averaged, in the order of `Losses`."""
        means = [total / max(self._count, 1) for total in self._sums]
        self._sums, self._count = [0.0] * len(means), 0
        return means

    def evaluate(self, x: Tensor, u: Tensor) -> list[float]:
        """Losses over all trajectories x (N, K+1, 6), u (N, K, 4), every target encoded."""
        sums = torch.zeros(len(Losses._fields), dtype=torch.float64)
        with torch.no_grad():
            for first in range(0, len(x), EVALUATION_CHUNK):
                rows = slice(first, first + EVALUATION_CHUNK)
                losses = total_loss(
                    self.model, self.config, _time_first(x[rows]), _time_first(u[rows])
                )
                sums += len(x[rows]) * torch.stack(losses).double()
        return [float(mean) for mean in sums / len(x)]

    def spectral_radius(self) -> float:
        """Largest magnitude of an eigenvalue of A, in float64; not a number where A is none."""
        A = self.model.operator().A.detach().double().numpy()
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
            running_sums=self._sums,
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
        self._sums, self._count = list(checkpoint.running_sums), checkpoint.running_count


def normalise(trajectories: Trajectories, scaling: Scaling) -> tuple[Tensor, Tensor]:
    """Scaled states (N, K+1, 6) and inputs with curvature (N, K, 4), float32."""
    curvature = np.broadcast_to(trajectories.kappa[:, None, None], (*trajectories.u.shape[:2], 1))
    u = np.concatenate([trajectories.u, curvature], axis=-1) / scaling.u_scale
    x = scaling.normalise_states(trajectories.x)
    return torch.from_numpy(x.astype(np.float32)), torch.from_numpy(u.astype(np.float32))


def _time_first(trajectories: Tensor) -> Tensor:
    return trajectories.transpose(0, 1).contiguous()

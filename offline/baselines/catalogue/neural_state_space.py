"""A nonlinear state-space model; see `offline.baselines.recurrent.network.StateSpace`."""

from offline.baselines.recurrent.network import Kind, Size
from offline.baselines.recurrent.training import Settings, recurrent

BASELINE = recurrent(Settings(Size(Kind.STATE_SPACE, layers=2, latents=24)))

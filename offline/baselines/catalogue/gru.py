"""A gated recurrent network; see `offline.baselines.recurrent.network`."""

from offline.baselines.recurrent.network import Kind, Size
from offline.baselines.recurrent.training import Settings, recurrent

BASELINE = recurrent(Settings(Size(Kind.GATED)))

"""EDMDc with up to 600 observables, Gaussians of state and curvature."""

from offline.baselines.dictionary.functions import Family
from offline.baselines.dictionary.search import LARGE, EdmdSettings, edmd

BASELINE = edmd(EdmdSettings(Family.GAUSSIANS, LARGE, past_steps=(4, 12), widths=(2.0, 4.0)))

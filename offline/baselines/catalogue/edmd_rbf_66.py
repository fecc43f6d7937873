"""EDMDc with 66 observables, Gaussians of state and curvature."""

from offline.baselines.dictionary.functions import Family
from offline.baselines.dictionary.search import SMALL, EdmdSettings, edmd

BASELINE = edmd(EdmdSettings(Family.GAUSSIANS, SMALL, widths=(1.0, 2.0, 4.0)))

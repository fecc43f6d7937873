"""EDMDc with up to 600 observables, random cosines of state and curvature."""

from offline.baselines.dictionary.functions import Family
from offline.baselines.dictionary.search import LARGE, EdmdSettings, edmd

BASELINE = edmd(EdmdSettings(Family.COSINES, LARGE, past_steps=(4, 12), widths=(6.0, 12.0)))

"""EDMDc with 66 observables, random cosines of state and curvature."""

from offline.baselines.dictionary.functions import Family
from offline.baselines.dictionary.search import SMALL, EdmdSettings, edmd

BASELINE = edmd(EdmdSettings(Family.COSINES, SMALL, widths=(3.0, 6.0, 12.0)))

"""EDMDc with up to 600 observables, monomials of state and curvature."""

from offline.baselines.dictionary.functions import Family
from offline.baselines.dictionary.search import LARGE, EdmdSettings, edmd

BASELINE = edmd(EdmdSettings(Family.MONOMIALS, LARGE, past_steps=(4, 12)))

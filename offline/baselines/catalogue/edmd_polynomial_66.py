"""EDMDc with 66 observables, monomials of state and curvature."""

from offline.baselines.dictionary.functions import Family
from offline.baselines.dictionary.search import SMALL, EdmdSettings, edmd

BASELINE = edmd(EdmdSettings(Family.MONOMIALS, SMALL))

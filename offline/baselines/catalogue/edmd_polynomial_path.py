"""EDMDc of the motion with 66 observables, states, past and monomials; the path by kinematics."""

from offline.baselines.dictionary.functions import Family
from offline.baselines.dictionary.motion import edmd_with_path
from offline.baselines.dictionary.search import SMALL, EdmdSettings

BASELINE = edmd_with_path(EdmdSettings(Family.MONOMIALS, SMALL))

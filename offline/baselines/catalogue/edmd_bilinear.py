"""Bilinear EDMD: monomials, and inputs times observables of the prediction."""

from offline.baselines.dictionary.functions import Family
from offline.baselines.dictionary.search import LARGE, SMALL, EdmdSettings, Gains, edmd
from rt_controller.contract.model.follow import Follow

SETTINGS = EdmdSettings(
    Family.MONOMIALS,
    (*SMALL, *LARGE[:2]),
    past_steps=(4, 12),
    gains=(Gains.SPEED, Gains.STATES, Gains.PRODUCTS),
    follows=(Follow.PREDICTION,),
)
BASELINE = edmd(SETTINGS)

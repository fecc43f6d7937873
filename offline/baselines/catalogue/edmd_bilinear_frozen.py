"""Bilinear EDMD: inputs times observables of the free response or of the start."""

from dataclasses import replace

from offline.baselines.catalogue.edmd_bilinear import SETTINGS
from offline.baselines.dictionary.search import edmd
from rt_controller.contract.model.follow import Follow

BASELINE = edmd(replace(SETTINGS, follows=(Follow.START, Follow.FREE_RESPONSE)))

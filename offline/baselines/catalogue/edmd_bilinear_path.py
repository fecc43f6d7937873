"""Bilinear EDMD of the motion, with observables of the prediction; the path by kinematics."""

from offline.baselines.catalogue.edmd_bilinear import SETTINGS
from offline.baselines.dictionary.motion import edmd_with_path

BASELINE = edmd_with_path(SETTINGS)

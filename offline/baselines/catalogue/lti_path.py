"""One linear model of the motion for all speeds; the path follows by kinematics."""

from offline.baselines.scheduled.fit import LinearSettings, linear

BASELINE = linear(LinearSettings())

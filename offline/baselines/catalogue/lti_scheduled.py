"""A linear model of the motion, blended over speed; the path follows by kinematics."""

from offline.baselines.scheduled.fit import LinearSettings, linear

BASELINE = linear(LinearSettings(knots=(2, 3, 4, 6, 8, 12)))

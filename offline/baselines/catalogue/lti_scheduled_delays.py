"""A linear model of the motion with a past, blended over speed; the path follows by kinematics."""

from offline.baselines.scheduled.fit import LinearSettings, linear

SETTINGS = LinearSettings(past_steps=(2, 8, 20), knots=(2, 4, 8), ridges=(1e-10, 1e-6, 1e-4))
BASELINE = linear(SETTINGS)

"""A linear model of the motion with up to 20 past periods; the path follows by kinematics."""

from offline.baselines.catalogue.dmdc_delays import PAST_STEPS
from offline.baselines.scheduled.fit import LinearSettings, linear

BASELINE = linear(LinearSettings(past_steps=PAST_STEPS))

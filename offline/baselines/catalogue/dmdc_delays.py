"""DMDc: linear in the state and in up to 20 past periods."""

from offline.baselines.dictionary.functions import Family
from offline.baselines.dictionary.search import EdmdSettings, edmd
from offline.config import PAST_STEPS

SETTINGS = EdmdSettings(Family.NONE, past_steps=(1, 2, 3, 4, 6, 8, 12, 16, PAST_STEPS))
BASELINE = edmd(SETTINGS)

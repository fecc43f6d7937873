"""DMDc: linear in the state and in up to 20 past periods."""

from offline.baselines.dictionary.functions import Family
from offline.baselines.dictionary.search import EdmdSettings, edmd
from offline.config import PAST_STEPS as LONGEST_PAST

PAST_STEPS = (1, 2, 3, 4, 6, 8, 12, 16, LONGEST_PAST)
BASELINE = edmd(EdmdSettings(Family.NONE, past_steps=PAST_STEPS))

"""How long trajectories and memories are. No numpy here: the command line reads it."""

STEPS = 80
"""of a trajectory: the paper's horizon of 2 s"""

PAST_STEPS = 20
"""before its first state that are kept with it: the longest history a model may ask for"""

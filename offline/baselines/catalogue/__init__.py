"""One module for each baseline; its name with hyphens is the name of the baseline.

A module has `BASELINE = Baseline(fit=…)` (`offline.baselines.baseline.Baseline`). Nothing else has
to be changed for a new baseline: the registry finds the module by its file name, and imports it
only when the baseline is used.
"""

"""The path and the road ahead of a tick: do they continue those before, and the last known ones."""

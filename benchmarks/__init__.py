"""What everything takes, and what it takes others. Linear algebra in one thread, as in the loop."""

import os

# Before anything imports numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

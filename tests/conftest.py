"""Tests do their linear algebra as the programs do: in the thread that asks for it."""

import os

# Before anything imports numpy. More threads make small products ten times slower.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

"""Measurements that need more than the project itself: other solvers, whole drives, sizes."""

import os

# One thread for each library, set before any of them is imported: parallel speed is not compared.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

"""The same quadratic programs for everybody who can solve them."""

import os

# One thread each, set before any of them is imported: what a machine could do in parallel is not
# the question.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

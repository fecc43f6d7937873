"""Settings of the whole suite: threads of the linear algebra, garbage collector."""

import gc
import os
import signal
from collections.abc import Iterator
from itertools import count

import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers

# Before anything imports numpy: in the thread that asks for it, as the programs do. More threads
# make small products ten times slower.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Property tests try the same cases in every run, so that a failure is caused by the change.
# `--hypothesis-profile=explore` draws new cases. Hypothesis would also try constants of the modules
# that are loaded, which depend on the tests that ran before. No deadline: the machine may be busy.
if hasattr(providers, "_get_local_constants"):
    setattr(providers, "_get_local_constants", providers.Constants)  # noqa: B010
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None)
settings.load_profile("repeatable")


_tests_between_collections = count()


def pytest_runtest_setup() -> None:
    """Keep the collector from looking at the imported modules, which takes a third of a second.

    A drive ends this with `gc.unfreeze`. What is frozen is never collected, so from time to time
    everything is looked at.
    """
    if next(_tests_between_collections) % 50 == 0:
        gc.unfreeze()
        gc.collect()
    gc.freeze()


@pytest.fixture
def double_precision() -> Iterator[None]:
    """New tensors have float64."""
    import torch

    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


@pytest.fixture
def default_hang_up() -> Iterator[None]:
    """SIGHUP as in a terminal: a suite that is started by `nohup` ignores it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)

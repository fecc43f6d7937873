"""What every benchmark tells beside pytest-benchmark's own columns."""

from collections.abc import Iterator

import numpy as np
import pytest

QUANTILES = {"p50_us": 50.0, "p99_us": 99.0, "p999_us": 99.9}


@pytest.fixture(autouse=True)
def tails(benchmark) -> Iterator[None]:
    """Percentiles of the rounds in `extra_info`: a control loop lives by its tail."""
    yield
    if benchmark.stats is None:
        return  # benchmarks are switched off
    times_us = 1e6 * np.array(benchmark.stats.stats.data)
    for name, quantile in QUANTILES.items():
        benchmark.extra_info[name] = float(np.percentile(times_us, quantile, method="higher"))

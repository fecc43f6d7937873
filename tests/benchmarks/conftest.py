"""Benchmarks run when this folder is asked for; in the whole test suite each runs once, untimed.

Percentiles are added to what pytest-benchmark reports.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

QUANTILES = {"p50_us": 50.0, "p99_us": 99.0, "p999_us": 99.9}


def _is_only_folder(config: pytest.Config) -> bool:
    folder = Path(__file__).parent
    paths = [
        Path(config.invocation_params.dir, arg.split("::")[0]).resolve() for arg in config.args
    ]
    return all(path == folder or folder in path.parents for path in paths)


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Run in one process if only this folder is asked for: parallel benchmarks disturb each other.

    `-n auto` is among the default options in pyproject.toml.
    """
    if _is_only_folder(config):
        config.option.numprocesses = 0


def pytest_configure(config: pytest.Config) -> None:
    """Enable benchmarks if only this folder is asked for.

    `--benchmark-disable` is among the default options in pyproject.toml; given on the command line
    it keeps its meaning.
    """
    is_disabled_by_user = "--benchmark-disable" in config.invocation_params.args
    if _is_only_folder(config) and not is_disabled_by_user:
        config.option.benchmark_disable = False


@pytest.fixture(autouse=True)
def percentiles(benchmark) -> Iterator[None]:
    """Percentiles of the rounds in `extra_info`: a control loop is limited by its slowest steps."""
    yield
    if benchmark.stats is None:
        return
    times_us = 1e6 * np.array(benchmark.stats.stats.data)
    for name, quantile in QUANTILES.items():
        benchmark.extra_info[name] = float(np.percentile(times_us, quantile, method="higher"))

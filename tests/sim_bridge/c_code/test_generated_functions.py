"""Random functions compute the same in C and in Python."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from c_compiler import needs_c_compiler
from c_library import build
from made_functions import FunctionMaker

pytestmark = needs_c_compiler

N_FUNCTIONS = 30


def assert_same(folder: Path, seed: int) -> None:
    file = folder / f"made_{seed}.py"
    file.write_text(FunctionMaker(seed).module(N_FUNCTIONS))
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    kernels = [getattr(module, f"f{number}") for number in range(N_FUNCTIONS)]
    # What Python computes is compared, not what numba makes of it: it would take minutes.
    module.swap, module.bump = FakeKernel(module.swap.py_func), FakeKernel(module.bump.py_func)
    shown = (1.0, 2.0, 1, 2, np.zeros(3))
    library = build(folder, [(kernel, shown) for kernel in kernels], flags=("-w",))
    rng = np.random.default_rng(seed)
    for kernel in kernels:
        for _ in range(5):
            a, b = (float(x) for x in rng.uniform(-4.0, 4.0, 2))
            i, j = (int(x) for x in rng.integers(-9, 9, 2))
            in_python, in_c = np.full(3, 0.25), np.full(3, 0.25)
            expected = kernel.py_func(a, b, i, j, in_python)
            found = library.call(kernel, a, b, i, j, in_c)
            assert found == pytest.approx(expected, rel=1e-12, abs=1e-12), (seed, kernel)
            np.testing.assert_allclose(in_c, in_python, rtol=1e-12)


class FakeKernel:
    """A function that counts as compiled and runs as Python."""

    def __init__(self, function) -> None:
        self.py_func = function

    def __call__(self, *arguments):
        return self.py_func(*arguments)


@pytest.mark.parametrize("seed", [1, 2])
def test_random_functions_are_equal(tmp_path: Path, seed: int) -> None:
    assert_same(tmp_path, seed)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(3, 23))
def test_many_random_functions_are_equal(tmp_path: Path, seed: int) -> None:
    assert_same(tmp_path, seed)

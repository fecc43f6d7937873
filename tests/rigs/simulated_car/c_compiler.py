"""A mark for tests that compile C."""

import os
import shutil

import pytest

needs_c_compiler = pytest.mark.skipif(
    shutil.which((os.environ.get("CC") or "cc").split()[0]) is None,
    reason="no C compiler is installed: apt-get install gcc libc6-dev",
)

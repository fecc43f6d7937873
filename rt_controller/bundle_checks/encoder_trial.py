"""The first run of an encoder, in a process with limits of time and memory.

An ONNX file may compute without end or fill the memory. An encoder that has passed once on this
machine is not tried again: the user's cache keeps the hashes.
"""

import io
import os
import subprocess
import sys

import numpy as np

from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.identity_encoder import identity_encoder
from rt_controller.contract.user_cache import is_marked, mark
from rt_controller.control.encoder_file import require_self_contained

LONGEST_CPU_S = 10
LONGEST_S = 120.0
"""of a process that hardly gets processor time"""
MOST_MEMORY_BYTES = 2 << 30
TOO_LARGE = 4
"""exit code of the process if there was no memory"""
FOLDER = "tried-encoders"

_tried: set[str] = set()


def require_bounded(bundle: Bundle) -> None:
    """Return if the encoder of a bundle loads and runs within the limits, now or earlier.

    Any other fault of the encoder is left to those that use it.

    Raises:
        ArtifactError: it does not, or has data in other files.
    """
    sha256 = bundle.encoder_sha256
    if sha256 in _tried or bundle.encoder_onnx == identity_encoder(len(bundle.schema.states)):
        return
    require_self_contained(bundle.encoder_onnx)
    if not is_marked(FOLDER, sha256):
        _try_in_process(bundle)
        mark(FOLDER, sha256)
    _tried.add(sha256)


def _try_in_process(bundle: Bundle) -> None:
    packed = io.BytesIO()
    samples = {name: getattr(bundle.selftest, name) for name in bundle.lift.inputs}
    np.savez(packed, onnx=np.frombuffer(bundle.encoder_onnx, np.uint8), **samples)
    command = [sys.executable, "-m", "rt_controller.bundle_checks.encoder_trial"]
    try:
        done = subprocess.run(
            command, input=packed.getvalue(), capture_output=True, timeout=LONGEST_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise _refused(f"more than {LONGEST_S:g} s") from None
    if done.returncode == TOO_LARGE:
        raise _refused(f"more than {MOST_MEMORY_BYTES >> 30} GiB of memory")
    if done.returncode < 0:
        raise _refused(f"that it was ended by signal {-done.returncode} (time or memory)")
    if done.returncode > 0:
        raise _refused(f"that its process failed: {done.stderr.decode(errors='replace')[-200:]}")


def _refused(found: str) -> ArtifactError:
    return ArtifactError(
        f"encoder.onnx: expected an encoder that loads and lifts its self-test within "
        f"{LONGEST_CPU_S} s of processor time and {MOST_MEMORY_BYTES >> 30} GiB, found {found}. "
        f"Run offline-export again, or choose another `model`."
    )


def main() -> None:
    """Load the encoder on stdin and lift its self-test, within the limits."""
    try:
        import resource
    except ImportError:  # not on every system; the time is limited by the caller
        pass
    else:
        for kind, most in (
            (resource.RLIMIT_CPU, LONGEST_CPU_S),
            (resource.RLIMIT_DATA, MOST_MEMORY_BYTES),
            (resource.RLIMIT_CORE, 0),
        ):
            hard = resource.getrlimit(kind)[1]  # of the system; it cannot be raised
            lower = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (lower, lower))
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime as ort

    arrays = dict(np.load(io.BytesIO(sys.stdin.buffer.read())))
    onnx = arrays.pop("onnx").tobytes()
    options = ort.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        session = ort.InferenceSession(onnx, options, providers=["CPUExecutionProvider"])
        for row in range(len(arrays["x"])):
            inputs = {name: part[row : row + 1] for name, part in arrays.items()}
            session.run(None, {name: part.astype(np.float32) for name, part in inputs.items()})
    except Exception as error:  # onnxruntime raises many types, none public
        if isinstance(error, MemoryError) or "alloc" in str(error):
            sys.exit(TOO_LARGE)


if __name__ == "__main__":
    main()

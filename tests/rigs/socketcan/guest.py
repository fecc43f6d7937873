"""First process of user-mode Linux: CAN modules, a network interface, one command, power off.

It is started by the kernel with the arguments of `user_mode_linux.run` and stands alone: standard
library only. The root is that of the host and cannot be written, `/tmp` with the environment of the
tests included. `/run` is new, and the folder of the results is the only place of the host that is
written.
"""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

MODULES = (
    "net/can/can.ko",
    "net/can/can-raw.ko",
    "net/can/can-bcm.ko",
    "drivers/net/can/dev/can-dev.ko",
    "drivers/net/can/vcan.ko",
    "drivers/net/can/slcan/slcan.ko",
)
_SYS_FINIT_MODULE = 313
_POWER_OFF = 0x4321FEDC
_libc = ctypes.CDLL(None, use_errno=True)


def require(result: int, what: str) -> None:
    if result != 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")


def mount(kind: str, place: str, options: str = "") -> None:
    result = _libc.mount(kind.encode(), place.encode(), kind.encode(), 0, options.encode())
    require(result, f"mount {kind} on {place}")


def load_module(file: Path) -> None:
    with file.open("rb") as opened:
        result = _libc.syscall(_SYS_FINIT_MODULE, opened.fileno(), b"", 0)
    require(result, f"module {file.name}")


def prepare(modules: str, results: str) -> None:
    """Mounts, modules, and the interfaces lo and vcan0."""
    mount("proc", "/proc")
    mount("sysfs", "/sys")
    mount("tmpfs", "/run")
    Path("/run/results").mkdir()
    mount("hostfs", "/run/results", results)
    # A flood is lost in the socket that is tested, and not in the queue of the processor.
    Path("/proc/sys/net/core/netdev_max_backlog").write_text("100000")
    folder = Path(modules) / os.uname().release / "kernel"
    for name in MODULES:
        load_module(folder / name)
    for command in (
        "link set lo up",
        "link add vcan0 type vcan",
        "link set vcan0 mtu 72",
        "link set vcan0 up",
    ):
        subprocess.run(["ip", *command.split()], check=True)


def main(modules: str, results: str, folder: str, *command: str) -> int:
    """Exit status of the command, which runs in `folder`."""
    prepare(modules, results)
    return subprocess.run(command, cwd=folder, check=False, stdin=subprocess.DEVNULL).returncode


if __name__ == "__main__":
    status = 1
    try:
        status = main(*sys.argv[1:])
        (Path("/run/results") / "status").write_text(str(status))
    except Exception as error:
        print(f"guest: {type(error).__name__}: {error}", flush=True)
    finally:
        sys.stdout.flush()
        os.sync()
        _libc.reboot(_POWER_OFF)

"""A folder belongs to one worker at a time, and to nobody once that worker is dead."""

import subprocess
import sys
import threading

from offline.campaign.claim import FILE, claimed

HOLD = """
import sys, time
from pathlib import Path
from offline.campaign.claim import claimed
with claimed(Path(sys.argv[1]), lambda: False) as is_ours:
    print(is_ours, flush=True)
    time.sleep(600)
"""


def never() -> bool:
    return False


def at_once() -> bool:
    return True


def hold(folder) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", HOLD, str(folder)]
    holder = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None
    assert holder.stdout.readline() == "True\n"
    return holder


def test_a_folder_that_another_process_has_is_not_ours(tmp_path):
    holder = hold(tmp_path)
    try:
        with claimed(tmp_path, at_once) as is_ours:
            assert not is_ours
        assert (tmp_path / FILE).read_text().startswith(f"{holder.pid} on ")
    finally:
        holder.kill()
        holder.communicate()


def test_the_folder_of_a_killed_process_is_free(tmp_path):
    holder = hold(tmp_path)
    holder.kill()
    holder.communicate()
    with claimed(tmp_path, at_once) as is_ours:
        assert is_ours


def test_whoever_waits_gets_the_folder_when_it_is_free(tmp_path):
    got = []
    with claimed(tmp_path, never):

        def wait() -> None:
            with claimed(tmp_path, never) as is_ours:
                got.append(is_ours)

        waiting = threading.Thread(target=wait, daemon=True)
        waiting.start()
        waiting.join(timeout=0.5)
        assert not got
    waiting.join(timeout=60)
    assert got == [True]

"""Processes that draw: they end with who asked, however that ends."""

import os
import subprocess
import sys
import time

import pytest

PARENT = """
import os, time
from armsight.recognition.data.crews import Processes
if __name__ == "__main__":
    crew = Processes(1)
    print(crew._pool.submit(os.getpid).result(), flush=True)
    time.sleep(600)
"""


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks for processes in /proc")
def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    parent = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True)
    worker = int(parent.stdout.readline())
    parent.kill()
    parent.communicate()
    deadline = time.monotonic() + 60.0
    while os.path.exists(f"/proc/{worker}/fd") and time.monotonic() < deadline:
        time.sleep(0.1)
    left = os.path.exists(f"/proc/{worker}/fd")
    if left:
        os.kill(worker, 9)
    assert not left

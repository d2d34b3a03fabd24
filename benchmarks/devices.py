"""How soon a run ends when the arm's driver hangs: from the hang to the end of the process.

python benchmarks/devices.py [REPEATS]

A patrol on an arm behind a driver is run as a process of its own; after 0.5 s of commands one of
the driver's calls never returns. Printed are the seconds from then to the end of the process, its
exit code and the last line that it said.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

DRIVER = """
import os, threading, time
import numpy as np
from armsight.devices.port import ArmReading

class Arm:
    def __init__(self, settings):
        self.q, self.v = np.deg2rad([0.0, -90, 90, -90, -90, 0]), np.zeros(6)
        self.at = time.monotonic()
        self.what, self.since = settings.connection["hangs"], None
    def maybe(self, what):
        late = self.since is not None and time.monotonic() > self.since + 0.5
        if what == self.what and late:
            if not os.path.exists("hung"):
                open("hung", "w").write(repr(time.time()))
            threading.Event().wait()
    def read(self):
        self.maybe("read")
        now = time.monotonic()
        self.q, self.at = self.q + (now - self.at) * self.v, now
        return ArmReading(now, self.q, self.v)
    def command_velocity(self, velocity):
        self.since = self.since or time.monotonic()
        self.maybe("command")
        self.v = velocity
    def stop(self):
        self.v = np.zeros(6)
        self.maybe("stop")
    def close(self):
        self.maybe("close")
"""
CELL = """
[cell]
name = "hangs"
[robot]
model = "ur5"
driver = "hanging_arm:Arm"
connection = { hangs = "WHAT" }
[mapping]
voxel = 0.1
[patrol.goals_deg]
A = [0, -90, 90, -90, -90, 0]
B = [30, -90, 90, -90, -90, 0]
"""


def once(what: str) -> tuple[float, int, str]:
    """Seconds from the hang to the process's end, its exit code, its last line."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "hanging_arm.py").write_text(DRIVER)
        (place / "cell.toml").write_text(CELL.replace("WHAT", what))
        # A stop or a close comes at the end of the run.
        seconds = "60" if what in ("read", "command") else "20"
        ended = subprocess.run(
            [
                sys.executable,
                "-m",
                "armsight",
                "patrol",
                "cell.toml",
                "--headless",
                "--seconds",
                seconds,
            ],
            cwd=place,
            env=os.environ | {"ARMSIGHT_RUNTIME_DIR": folder},
            capture_output=True,
            text=True,
            check=False,
        )
        now = time.time()
        return (
            now - float((place / "hung").read_text()),
            ended.returncode,
            ended.stderr.splitlines()[-1],
        )


def main(repeats: int) -> None:
    print(f"{'hangs':8} {'median':>7} {'worst':>7}  exit  said")
    for what in ("read", "command", "stop", "close"):
        runs = [once(what) for _ in range(repeats)]
        took = [run[0] for run in runs]
        codes = sorted({run[1] for run in runs})
        figures = f"{statistics.median(took):6.2f} s {max(took):5.2f} s"
        print(f"{what:8} {figures}  {codes}  {runs[-1][2]}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 3)

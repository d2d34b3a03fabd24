"""Who is killed while it writes its journal leaves the old one or the new one, never half."""

import os
import random
import signal
import time

import numpy as np

from armsight.charging.journal import Entry, Journal
from armsight.geometry.pose import make_pose


def test_a_journal_is_whole_whenever_its_writer_is_killed(tmp_path):
    file, rng = tmp_path / "station.json", random.Random(0)
    entry = Entry("type2", "type2_plug", np.eye(4), np.eye(6), make_pose(None, (0, 0, 0.1)))
    Journal(file).write(entry)
    for _ in range(40):
        pid = os.fork()
        if pid == 0:
            while True:
                for plugged in (True, False):
                    Journal(file).write(Entry(**vars(entry) | {"plugged": plugged}))
        time.sleep(rng.uniform(0.0, 0.02))
        os.kill(pid, signal.SIGKILL)
        assert os.WTERMSIG(os.waitpid(pid, 0)[1]) == signal.SIGKILL
        assert Journal(file).read().plug == "type2_plug"

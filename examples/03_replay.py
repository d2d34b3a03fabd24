"""Records a cell, then drives the same mapping from the recording: both maps are alike.

python examples/03_replay.py [FILE.mcap]
"""

import sys
from pathlib import Path

from armsight import Recorder, Session, load_workcell, open_cell, open_recording, packaged
from armsight.mapping.snapshot import OCCUPIED
from armsight.recording.replay_parts import replay_parts


def main(file: Path) -> None:
    with open_cell(load_workcell(packaged()["ur3_bench"])) as cell:
        recorder = Recorder(file, cell)
        session = Session(cell, None, observers=(recorder,))
        session.run(1.0)
        recorder.close()
        live = (session.view().snapshot.state == OCCUPIED).sum()
    with open_recording(file) as cell:
        session = Session(cell, None, make=replay_parts)
        session.run(1.0)
        replayed = (session.view().snapshot.state == OCCUPIED).sum()
    print(f"occupied voxels, live {live}, replayed {replayed}; {file.stat().st_size / 1e6:.0f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "monday.mcap"))

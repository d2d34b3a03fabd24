"""Watches a cell and looks into the map: what is occupied, what is free, what nobody sees?

python examples/01_watch.py [WORKCELL]
"""

import sys

from armsight import Session, load_workcell, open_cell
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN
from armsight.workcell.packaged import find


def main(file: str) -> None:
    with open_cell(load_workcell(find(file))) as cell:
        session = Session(cell, None)  # no task: the arm holds still
        session.run(1.0)
        view = session.view()
    snapshot = view.snapshot
    litres = 1000 * snapshot.grid.voxel**3
    for name, state in (("occupied", OCCUPIED), ("free", FREE), ("unseen", UNKNOWN)):
        print(f"{name:9} {(snapshot.state == state).sum() * litres:8.0f} litres")
    print(f"nearest place where somebody could be: {view.guard.distance:.2f} m from the arm")
    for camera in snapshot.cameras:
        print(f"camera {camera.name}: {camera.frames} frames, alive: {camera.alive}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "ur5_four_cameras")

"""``armsight replay``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from armsight.commands.serving import Page

if TYPE_CHECKING:
    from armsight.mapping.snapshot import WorkspaceSnapshot
    from armsight.runtime.view import SessionView
    from armsight.workcell import Cell


MAP_FILES = (".bt", ".ply")
"""Kinds of files that a map is written into."""


@dataclass(frozen=True)
class Replay:
    """Replay a recording through the same mapping and page as when it was made.

    Examples: armsight replay monday.mcap;
    armsight replay monday.mcap --headless --map monday.bt

    Attributes:
        source: a recording (.mcap), or a folder of posed depth images (frame-NNNNNN.depth.png,
            frame-NNNNNN.pose.txt).
        seconds: stop after so long; if left out, the page stays until Ctrl-C, and a headless replay
            ends with the recording.
        headless: no page, and as fast as the machine can; prints what the map holds at the end.
        json: write the run's figures here; `-` is standard output.
        map: write the map at the end here: free and occupied space as an OctoMap (NAME.bt), or
            the merged cloud (NAME.ply), in base.
        speed: recorded seconds a second; 0 for as fast as the machine can.
        page: where the live page is served.
    """

    source: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    seconds: float | None = None
    headless: bool = False
    json: Path | None = None
    map: Path | None = None
    speed: float | None = None
    page: Page = field(default_factory=Page)

    def run(self) -> int:
        """Replay; the recorded task shows what it showed."""
        from armsight.commands.running import RunOptions, run_session, say, speed_of, write_summary
        from armsight.errors import RecordingError, UsageError
        from armsight.recording.replay_parts import HoldAtEnd, recorded_task, replay_parts

        if self.map is not None and self.map.suffix not in MAP_FILES:
            raise UsageError(f"--map {self.map}: name a file that ends in {' or '.join(MAP_FILES)}")
        if not self.source.exists():
            raise RecordingError(f"{self.source}: no such recording or folder of depth images")
        with _open(self.source) as cell:
            note = getattr(cell.world, "note", "")
            if note:
                say(note)
            end = getattr(cell.world, "duration", None)
            wanted = RunOptions(
                seconds=self.seconds if self.seconds is not None or not self.headless else end,
                page=None if self.headless else self.page,
                speed=speed_of(self.speed, self.headless),
                observers=() if self.headless else (HoldAtEnd(),),
                make=replay_parts,
            )
            session = run_session(cell, recorded_task(cell), wanted)
            view = session.view()
        summary = map_summary(view)
        for key, value in summary.items():
            say(f"{key.replace('_', ' '):18} {value}")
        for camera in view.snapshot.cameras if view.snapshot is not None else ():
            if camera.frames == 0 and camera.dropped:
                say(f"{camera.name}: nothing that it says is in the map: {camera.reason}")
        if self.json is not None:
            write_summary(self.json, summary)
        if self.map is not None:
            write_map(self.map, view.snapshot)
            say(f"wrote {self.map}")
        return 0


def _open(source: Path) -> Cell:
    from armsight.recording.depth_folder import open_depth_folder
    from armsight.recording.replay import open_recording

    return open_depth_folder(source) if source.is_dir() else open_recording(source)


def map_summary(view: SessionView) -> dict[str, float | int]:
    """What the map holds, in figures."""
    from armsight.mapping.snapshot import FREE, OCCUPIED

    snapshot = view.snapshot
    if snapshot is None:
        return {"seconds": round(view.now, 3), "frames": 0}
    return {
        "seconds": round(view.now, 3),
        "frames": sum(camera.frames for camera in snapshot.cameras),
        "dropped": sum(camera.dropped for camera in snapshot.cameras),
        "snapshots": snapshot.sequence + 1,
        "voxels_occupied": int((snapshot.state == OCCUPIED).sum()),
        "voxels_free": int((snapshot.state == FREE).sum()),
        "cloud_points": len(snapshot.cloud),
    }


def write_map(file: Path, snapshot: WorkspaceSnapshot | None) -> None:
    """Write a map as OctoMap ``.bt`` or its cloud as ``.ply``, whole or not at all.

    Raises:
        RecordingError: there was no frame, so there is no map.
        ArmsightError: the file cannot be written.
    """
    from armsight.errors import RecordingError
    from armsight.geometry.cloud import write_ply
    from armsight.mapping.octomap_io import from_state, write_bt

    if snapshot is None:
        raise RecordingError(f"{file}: not written: nothing was seen, so there is no map")
    if file.suffix == ".bt":
        write_bt(file, from_state(snapshot.state, snapshot.grid))
    else:
        write_ply(file, snapshot.cloud)

"""``armsight calibrate``."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from armsight.commands.serving import Page

if TYPE_CHECKING:
    from armsight.calibration.live.seen import SeenView
    from armsight.calibration.live.watcher import Progress

PLANNING = 0.2
"""Of a core for a path: nobody is near, so there is time [s]."""
PATIENCE = 600.0
"""A solve may take this long on a slow machine before the task is given up [s]."""


@dataclass(frozen=True)
class Calibrate:
    """Calibrate a cell's cameras by the board that its arm carries, or a recorded set.

    Examples: armsight calibrate ur5_calibration --out calibration;
    armsight calibrate --from recordings/monday --board checkerboard:9x7:25;
    armsight calibrate ur5_four_cameras --markerless; armsight calibrate ur10_charging --plug

    Attributes:
        workcell: a workcell file, or the name of a packaged cell, to calibrate live.
        from_: a folder of images and poses to solve instead; docs/calibration.md lists the layouts.
        out: folder for results and report; a stopped run goes on from the views in it.
        board: which board, sizes in mm, such as checkerboard:7x5:30 or charuco:5x7:36:27.
        lens: a file with the lens of a recorded set (ROS camera_info, OpenCV or ViSP).
        keep_lenses: the lenses stay as they are: those of --lens, or those that the cameras report.
        hand: the camera of a recorded set is on the flange, the board beside the arm; beside: the
            camera is beside the arm. Without either the pictures tell.
        compare: show OpenCV's solvers beside ours on a recorded set: the same corners, the errors
            in views left out.
        second_arm: the folder of a second arm, before the same fixed camera or with a camera before
            the same fixed board: its base in the first's is told, too.
        robot: model of the arm of a recorded set that has joint angles, such as ur5.
        goal_mm: stop when points 1.0-1.5 m away are this sure.
        views: at most.
        paper: T1's staged trajectory instead of views chosen by information.
        write: put what was found into the cell's calibration file, which everything then reads.
        sphere: no board: the fixed cameras are registered by a ball of 150 mm that the arm carries
            (the tool sphere_marker); their lenses stay as they are.
        plug: no board: a standing stereo pair and the charging plug in the hand are calibrated by
            showing the plug to the pair (docs/charging.md); people are looked out for as ever.
        wrist: no board: the stereo pair on the flange is calibrated by its own looks at a red ball
            of 80 mm that stands still before the arm; nobody may be in the cell meanwhile.
        markerless: no board: the fixed cameras are placed by their view of the arm on its patrol.
        camera: only this one, with --markerless; which pair, with --plug; or whose pictures a
            recorded set has, with --from and a workcell whose calibration file is to keep it.
        fresh: forget the views of an earlier run.
        force: overwrite a better calibration, in the folder or the cell; write what a recorded set
            tells although something is wrong with it.
        seed: of everything random.
        cell_is_empty: somebody has made sure that nobody is in the (real) cell, and stays out.
        headless: no live page.
        page: where the live page of a live calibration is served; it ends with the calibration.
    """

    workcell: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="WORKCELL")] = None
    from_: Annotated[Path | None, tyro.conf.arg(name="from", metavar="FOLDER")] = None
    out: Path = Path("calibration")
    board: str | None = None
    lens: Path | None = None
    keep_lenses: bool = False
    hand: bool = False
    compare: bool = False
    beside: bool = False
    second_arm: Path | None = None
    robot: str | None = None
    goal_mm: float = 1.2
    views: int = 60
    paper: bool = False
    write: bool = True
    sphere: bool = False
    plug: bool = False
    wrist: bool = False
    markerless: bool = False
    camera: str | None = None
    fresh: bool = False
    force: bool = False
    seed: int = 0
    cell_is_empty: bool = False
    headless: bool = False
    page: Page = field(default_factory=Page)

    def run(self) -> int:
        """Calibrate; prints the report, writes the results."""
        from armsight.commands.calibrate_options import refuse_unused

        refuse_unused(self)
        page = None if self.headless else self.page
        if self.from_ is not None:
            from armsight.commands.calibrate_recorded import calibrate_recorded

            return calibrate_recorded(self)
        assert self.workcell is not None
        if self.plug:
            from armsight.commands.calibrate_plug import LOOKS, PlugOptions, calibrate_plug

            options = PlugOptions(
                self.out,
                self.camera,
                min(self.views, LOOKS),
                self.write,
                self.fresh,
                self.seed,
                self.cell_is_empty,
                page,
            )
            return calibrate_plug(self.workcell, options)
        if self.sphere:
            from armsight.commands.calibrate_sphere import calibrate_sphere

            return calibrate_sphere(
                self.workcell, self.seed, self.write, self.cell_is_empty, page, self.force
            )
        if self.wrist:
            from armsight.commands.calibrate_wrist import calibrate_wrist

            return calibrate_wrist(self.workcell, self.seed, self.write, self.cell_is_empty, page)
        if self.markerless:
            from armsight.commands.calibrate_markerless import calibrate_markerless

            return calibrate_markerless(
                self.workcell,
                self.camera,
                self.seed,
                self.write,
                page=page,
                cell_is_empty=self.cell_is_empty,
                force=self.force,
            )
        return self._live()

    def _live(self) -> int:
        import numpy as np

        from armsight.calibration import report, views_file
        from armsight.calibration.export import write_results
        from armsight.calibration.live.log import ProcedureOptions
        from armsight.commands.calibrating import (
            drawn_with,
            nobody_inside,
            refuse_worse,
            result_of,
            say,
        )
        from armsight.commands.ending import EndsWhen
        from armsight.commands.running import INTERRUPTED, RunOptions, run_session
        from armsight.errors import CalibrationError
        from armsight.runtime.config import SessionConfig
        from armsight.runtime.configure import mapping_config
        from armsight.tasks.calibrate import CalibrateTask
        from armsight.tasks.calibration_cell import (
            calibration_setup,
            to_calibrate,
            unseen_is_empty,
        )
        from armsight.tasks.calibration_entries import arm_of, board_of_cell, camera_entries
        from armsight.workcell import open_cell
        from armsight.workcell.calibration_file.store import store
        from armsight.workcell.packaged import load
        from armsight.writing import write_text

        assert self.workcell is not None
        workcell = to_calibrate(load(self.workcell), self.board)
        log = self.out / "views.jsonl"
        about: dict[str, object] = {
            "cell": workcell.name,
            "cameras": [c.name for c in workcell.camera],
            "board": workcell.board.kind if workcell.board is not None else "",
            "lenses": "kept" if self.keep_lenses else "solved",
        }
        with open_cell(workcell, self.seed, calibrated=False) as cell:
            about |= drawn_with(cell, self.seed)
            nobody_inside(cell, self.cell_is_empty)
            mapping = unseen_is_empty(mapping_config(workcell, cell.T_world_base, cell.robot.reach))
            setup = calibration_setup(cell, mapping, self.keep_lenses)
            if self.fresh:
                log.unlink(missing_ok=True)
            done = views_file.read(log, about)
            last = _when(log) if done else ""
            views_file.begin(log, about)
            if done:
                print(
                    f"going on from {len(done)} views in {log}, the last of {last}; if anything "
                    "was moved since, --fresh starts anew"
                )
            options = ProcedureOptions(
                goal=1e-3 * self.goal_mm, most_views=self.views, paper=self.paper
            )
            rng = np.random.default_rng(self.seed)
            task = CalibrateTask(setup, options, rng, _Terminal(log), done)
            session = run_session(
                cell,
                task,
                RunOptions(
                    page=None if self.headless else self.page,
                    seed=self.seed,
                    speed=math.inf,
                    observers=(EndsWhen(lambda: task.done),),
                    config=SessionConfig(
                        mapping=mapping, patience=PATIENCE, planning_time=PLANNING
                    ),
                ),
            )
            seconds = session.now()
            infos = {camera.info.name: camera.info for camera in cell.cameras}
        result = result_of(task, session)
        if result is None:
            print(f"stopped; the views are in {log}: the same command goes on from them")
            return INTERRUPTED
        say("")
        findings = result.findings
        print(f"{len(result.views)} views in {seconds:.0f} s of robot time: {result.stopped}")
        for line in report.lines(result.calibration, result.depth, findings):
            print(line)
        title = f"Calibration of {workcell.name}"
        page = report.page(result.calibration, result.depth, findings, title)
        write_results(self.out, result.calibration, result.depth, findings, self.force)
        write_text(self.out / "report.html", page)
        if self.write:
            wrong = [f for f in findings if f.severity == "error"]
            if wrong:
                raise CalibrationError(
                    f"{workcell.name}: its calibration was not changed: {wrong[0].message}; the "
                    f"results are in {self.out}, and --fresh takes all views anew"
                )
            source = f"armsight calibrate, live, {len(result.views)} views"
            entries = camera_entries(
                workcell, result.calibration, result.depth, source, infos=infos
            )
            refuse_worse(workcell, entries, self.force)
            board = board_of_cell(workcell, result.calibration, source)
            file = store(workcell, entries, arm_of(result.calibration, source), board)
            print(f"{file}: {', '.join(e.name for e in entries)} calibrated")
            # They have told what they had to: a later run is made because something was moved.
            log.replace(log.with_name("views_used.jsonl"))
        print(f"written to {self.out}; open {self.out / 'report.html'}")
        return 0


def _when(file: Path) -> str:
    return f"{datetime.fromtimestamp(file.stat().st_mtime):%Y-%m-%d %H:%M}"


class _Terminal:
    """Progress in the terminal; views into the file."""

    def __init__(self, log: Path) -> None:
        self._log = log

    def stage(self, progress: Progress) -> None:
        from armsight.commands.calibrating import say

        sure = [e for e in progress.expected if e == e]
        words = f", points to {1e3 * max(sure):.1f} mm" if sure else ""
        say(f"{progress.stage}: {progress.views} views{words}")

    def view(self, view: SeenView) -> None:
        from armsight.calibration import views_file

        views_file.append(self._log, view)

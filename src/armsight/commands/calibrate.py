"""``armsight calibrate``."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from armsight.commands.serving import Page

if TYPE_CHECKING:
    from armsight.calibration.boards import Board
    from armsight.calibration.live.seen import SeenView
    from armsight.calibration.live.watcher import Progress, Watcher
    from armsight.calibration.recorded_set import RecordedSet
    from armsight.calibration.recorded_solve import RecordedAnswer


@dataclass(frozen=True)
class Calibrate:
    """Calibrate a cell's cameras by the board that its arm carries, or a recorded set.

    Examples: armsight calibrate ur5_calibration --out calibration;
    armsight calibrate --from recordings/monday --board checkerboard:9x7:25;
    armsight calibrate ur5_four_cameras --markerless

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
        robot: model of the arm of a recorded set that has joint angles, such as ur5.
        goal_mm: stop when points 1.0-1.5 m away are this sure.
        views: at most.
        paper: T1's staged trajectory instead of views chosen by information.
        write: put what was found into the cell's calibration file, which everything then reads.
        markerless: no board: the fixed cameras are placed by their view of the arm on its patrol.
        camera: only this one, with --markerless.
        fresh: forget the views of an earlier run.
        force: overwrite a better calibration.
        seed: of everything random.
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
    robot: str | None = None
    goal_mm: float = 1.2
    views: int = 60
    paper: bool = False
    write: bool = True
    markerless: bool = False
    camera: str | None = None
    fresh: bool = False
    force: bool = False
    seed: int = 0
    headless: bool = False
    page: Page = field(default_factory=Page)

    def run(self) -> int:
        """Calibrate; prints the report, writes the results."""
        from armsight.errors import UsageError

        if (self.workcell is None) == (self.from_ is None):
            raise UsageError(
                "calibrate: give a workcell to calibrate live, or --from FOLDER for a recorded set"
            )
        if self.camera is not None and not self.markerless:
            raise UsageError("calibrate: --camera goes with --markerless")
        if self.markerless:
            from armsight.commands.calibrate_markerless import calibrate_markerless

            if self.workcell is None:
                raise UsageError("calibrate: --markerless watches a live cell, not --from a folder")
            return calibrate_markerless(self.workcell, self.camera, self.seed, self.write)
        return self._recorded() if self.from_ is not None else self._live()

    def _board(self) -> Board | None:
        from armsight.calibration.boards import parse_board

        return parse_board(self.board) if self.board is not None else None

    def _recorded(self) -> int:
        from armsight.calibration import report
        from armsight.calibration.export import write_results
        from armsight.calibration.recorded_set import load
        from armsight.calibration.recorded_solve import solve_set
        from armsight.errors import UsageError
        from armsight.robots import load_robot
        from armsight.writing import write_text

        assert self.from_ is not None
        if self.hand and self.beside:
            raise UsageError("calibrate: --hand and --beside exclude each other")
        mount: Literal["base", "flange"] | None = None
        if self.hand or self.beside:
            mount = "flange" if self.hand else "base"
        robot = load_robot(self.robot) if self.robot is not None else None
        recorded = load(self.from_, self._board(), self.lens, _say, mount)
        _say("")
        for line in report.read_lines(recorded):
            print(line)
        answer = solve_set(recorded, robot, self.seed, _say, self.keep_lenses)
        _say("")
        if answer.lenses:
            return self._lenses(recorded, answer)
        if answer.calibration is None:
            for finding in answer.findings:
                print(finding)
            print("nothing was written: mend what is wrong first", file=sys.stderr)
            return 1
        for line in report.lines(answer.calibration, (), answer.findings):
            print(line)
        if self.compare:
            from armsight.calibration.peers import compare, peer_lines

            for line in peer_lines(compare(answer.calibration)):
                print(line)
        wrong = any(f.severity == "error" for f in answer.findings)
        if wrong and not self.force:
            print("nothing was written: mend what is wrong first, or use --force", file=sys.stderr)
            return 1
        write_results(self.out, answer.calibration, (), answer.findings, self.force)
        page = report.page(answer.calibration, (), answer.findings, f"Calibration of {self.from_}")
        write_text(self.out / "report.html", page)
        print(f"written to {self.out}; open {self.out / 'report.html'}")
        return 0

    def _lenses(self, recorded: RecordedSet, answer: RecordedAnswer) -> int:
        """Write the lenses of pictures without poses."""
        from armsight.calibration.export import camera_info_yaml, opencv_yaml
        from armsight.writing import write_text

        for camera, lens in zip(recorded.cameras, answer.lenses):
            c = lens.camera
            d = " ".join(f"{v:.4f}" for v in c.distortion)
            print(f"lens of {camera.name} from {lens.frames} frames, to {lens.rms_px:.2f} px:")
            print(f"  f {c.fx:.2f} {c.fy:.2f}, centre {c.cx:.2f} {c.cy:.2f}, k1 k2 p1 p2 k3 {d}")
            name = camera.name
            write_text(self.out / f"{name}.camera_info.yaml", camera_info_yaml(name, c))
            write_text(self.out / f"{name}.opencv.yaml", opencv_yaml(c))
        for finding in answer.findings:
            print(finding)
        print(f"written to {self.out}")
        return 0

    def _live(self) -> int:
        import numpy as np

        from armsight.calibration import report, views_file
        from armsight.calibration.export import write_results
        from armsight.calibration.live.drive import drive
        from armsight.calibration.live.log import ProcedureOptions
        from armsight.calibration.live.procedure import procedure
        from armsight.commands.calibration_store import store
        from armsight.errors import CalibrationError
        from armsight.experiments.calibration_cell import open_calibration_cell
        from armsight.tasks.calibration_entries import arm_of, camera_entries
        from armsight.workcell.drivers import SIMULATED
        from armsight.workcell.packaged import load
        from armsight.writing import write_text

        assert self.workcell is not None
        workcell = load(self.workcell)
        real = {workcell.robot.driver, *(c.driver for c in workcell.camera)} - {SIMULATED}
        if real:
            raise CalibrationError(
                f"{self.workcell}: live calibration drives simulated devices only so far (this "
                f"cell uses {', '.join(sorted(real))}); record images and poses, and use --from"
            )
        if not workcell.camera:
            raise CalibrationError(f"{self.workcell}: has no [[camera]] to calibrate")
        log = self.out / "views.jsonl"
        board = self._board()
        about = {
            "cell": workcell.name,
            "cameras": [c.name for c in workcell.camera],
            "board": self.board or "checkerboard:7x5:30",
            "lenses": "kept" if self.keep_lenses else "solved",
        }
        if self.fresh:
            log.unlink(missing_ok=True)
        done = views_file.read(log, about)
        views_file.begin(log, about)
        if done:
            print(f"going on from {len(done)} views in {log}; --fresh starts anew")
        cell = open_calibration_cell(
            workcell, board, self.seed, redraw=0.3, factory=self.keep_lenses
        )
        options = ProcedureOptions(
            goal=1e-3 * self.goal_mm, most_views=self.views, paper=self.paper
        )
        with ExitStack() as stack:
            stack.callback(cell.close)
            watchers: list[Watcher] = [_Terminal(log)]
            if not self.headless:
                from armsight.commands.calibrate_page import CalibrationPage

                page = CalibrationPage(cell.setup, workcell.name, self.page)
                stack.callback(page.close)
                print(f"live page: {page.url}", file=sys.stderr)
                for view in done:
                    page.view(view)
                watchers.append(page)
            watcher = _All(watchers)
            steps = procedure(
                cell.setup, options, np.random.default_rng(self.seed), watcher, cell.now, done
            )
            result = drive(steps, cell, cell)
            seconds = cell.now()
        _say("")
        findings = result.findings
        print(f"{len(result.views)} views in {seconds:.0f} s of robot time: {result.stopped}")
        for line in report.lines(result.calibration, result.depth, findings):
            print(line)
        write_results(self.out, result.calibration, result.depth, findings, self.force)
        title = f"Calibration of {workcell.name}"
        write_text(
            self.out / "report.html", report.page(result.calibration, result.depth, findings, title)
        )
        if self.write:
            wrong = [f for f in findings if f.severity == "error"]
            if wrong:
                raise CalibrationError(
                    f"{workcell.name}: its calibration was not changed: {wrong[0].message}; the "
                    f"results are in {self.out}"
                )
            source = f"armsight calibrate, live, {len(result.views)} views"
            entries = camera_entries(workcell, result.calibration, result.depth, source)
            file = store(workcell, entries, arm_of(result.calibration, source))
            print(f"{file}: {', '.join(e.name for e in entries)} calibrated")
        print(f"written to {self.out}; open {self.out / 'report.html'}")
        return 0


class _All:
    """Tells several watchers."""

    def __init__(self, watchers: list[Watcher]) -> None:
        self._watchers = watchers

    def stage(self, progress: Progress) -> None:
        for watcher in self._watchers:
            watcher.stage(progress)

    def view(self, view: SeenView) -> None:
        for watcher in self._watchers:
            watcher.view(view)


class _Terminal:
    """Progress in the terminal; views into the file."""

    def __init__(self, log: Path) -> None:
        self._log = log

    def stage(self, progress: Progress) -> None:
        sure = [e for e in progress.expected if e == e]
        words = f", points to {1e3 * max(sure):.1f} mm" if sure else ""
        _say(f"{progress.stage}: {progress.views} views{words}")

    def view(self, view: SeenView) -> None:
        from armsight.calibration import views_file

        views_file.append(self._log, view)


def _say(words: str) -> None:
    """One line of progress that replaces the last one on a terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{words}", end="", file=sys.stderr, flush=True)
    elif words:
        print(words, file=sys.stderr)

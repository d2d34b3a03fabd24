"""``armsight calibrate``."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from armsight.commands.serving import Page

if TYPE_CHECKING:
    from armsight.calibration.boards import Board
    from armsight.calibration.calibrate import Calibration
    from armsight.calibration.live.seen import SeenView
    from armsight.calibration.live.watcher import Progress
    from armsight.calibration.recorded_set import RecordedSet
    from armsight.calibration.recorded_solve import RecordedAnswer
    from armsight.robots.robot import Robot

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
        markerless: no board: the fixed cameras are placed by their view of the arm on its patrol.
        camera: only this one, with --markerless; which pair, with --plug; or whose pictures a
            recorded set has, with --from and a workcell whose calibration file is to keep it.
        fresh: forget the views of an earlier run.
        force: overwrite a better calibration.
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
        from armsight.errors import UsageError

        if self.workcell is None and self.from_ is None:
            raise UsageError(
                "calibrate: give a workcell to calibrate live, or --from FOLDER for a recorded set"
            )
        if self.camera is not None and not (self.markerless or self.plug or self.from_):
            raise UsageError("calibrate: --camera goes with --markerless, --plug or --from")
        if self.plug:
            from armsight.commands.calibrate_plug import PlugOptions, calibrate_plug

            if self.workcell is None or self.from_ is not None or self.sphere or self.markerless:
                raise UsageError(
                    "calibrate: --plug is shown to a pair of a live cell; it goes with neither "
                    "--from nor --sphere nor --markerless"
                )
            return calibrate_plug(
                self.workcell,
                PlugOptions(
                    self.out,
                    self.camera,
                    min(self.views, 26),
                    self.write,
                    self.fresh,
                    self.seed,
                    self.cell_is_empty,
                    None if self.headless else self.page,
                ),
            )
        if self.sphere:
            from armsight.commands.calibrate_sphere import calibrate_sphere

            if self.workcell is None or self.from_ is not None or self.markerless:
                raise UsageError(
                    "calibrate: --sphere is shown to the cameras of a live cell; it goes with "
                    "neither --from nor --markerless"
                )
            page = None if self.headless else self.page
            return calibrate_sphere(self.workcell, self.seed, self.write, self.cell_is_empty, page)
        if self.markerless:
            from armsight.commands.calibrate_markerless import calibrate_markerless

            if self.workcell is None or self.from_ is not None:
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
        recorded = load(self.from_, self._board(), self.lens, _say, mount, robot)
        answer = self._solved(recorded, robot)
        if answer.lenses:
            return self._lenses(recorded, answer)
        if answer.calibration is None:
            for finding in answer.findings:
                print(finding)
            print("nothing was written: mend what is wrong first", file=sys.stderr)
            return 1
        for line in report.lines(answer.calibration, (), answer.findings, recorded.names):
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
        if self.workcell is not None and self.write and not wrong:
            self._keep(answer.calibration)
        print(f"written to {self.out}; open {self.out / 'report.html'}")
        if self.second_arm is not None:
            return self._second(answer.calibration, mount, robot)
        return 0

    def _solved(self, recorded: RecordedSet, robot: Robot | None) -> RecordedAnswer:
        from armsight.calibration import report
        from armsight.calibration.recorded_solve import solve_set

        _say("")
        for line in report.read_lines(recorded):
            print(line)
        answer = solve_set(recorded, robot, self.seed, _say, self.keep_lenses)
        _say("")
        return answer

    def _second(
        self, first: Calibration, mount: Literal["base", "flange"] | None, robot: Robot | None
    ) -> int:
        """Solve the second arm's set, and say where it stands in the first's base."""
        import yaml

        from armsight.calibration.export import transform_entry, write_results
        from armsight.calibration.recorded_set import load
        from armsight.calibration.two_arms import two_arms
        from armsight.writing import write_text

        assert self.second_arm is not None
        print(f"second arm, {self.second_arm}:")
        recorded = load(self.second_arm, self._board(), self.lens, _say, mount, robot)
        answer = self._solved(recorded, robot)
        for finding in answer.findings:
            print(finding)
        wrong = any(f.severity == "error" for f in answer.findings)
        if answer.calibration is None or (wrong and not self.force):
            print("nothing was written of the second arm", file=sys.stderr)
            return 1
        found = two_arms(first, answer.calibration)
        print(found.words())
        folder = self.out / "second_arm"
        write_results(folder, answer.calibration, (), answer.findings, self.force)
        entry = transform_entry("base", "second_base", found.T_first_second)
        write_text(folder / "bases.yaml", yaml.safe_dump({"transforms": [entry]}, sort_keys=False))
        print(f"written to {folder}")
        return 0

    def _keep(self, answer: Calibration) -> None:
        """Put what a recorded set has told into the cell's calibration file."""
        from armsight.tasks.calibration_entries import camera_entries
        from armsight.workcell.calibration_file.store import store
        from armsight.workcell.packaged import load

        assert self.workcell is not None
        workcell = load(self.workcell)
        name = self.camera
        if name is None and len(workcell.camera) == len(answer.problem.rigs) == 1:
            name = workcell.camera[0].name
        source = f"armsight calibrate --from {self.from_}"
        entries = camera_entries(workcell, answer, (), source, name)
        file = store(workcell, entries)
        print(f"{file}: {', '.join(e.name for e in entries) or 'no camera'} calibrated")

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
        from armsight.calibration.live.log import ProcedureOptions
        from armsight.commands.calibrating import drawn_with, nobody_inside, result_of
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
            views_file.begin(log, about)
            if done:
                print(f"going on from {len(done)} views in {log}; --fresh starts anew")
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
            entries = camera_entries(
                workcell, result.calibration, result.depth, source, infos=infos
            )
            board = board_of_cell(workcell, result.calibration, source)
            file = store(workcell, entries, arm_of(result.calibration, source), board)
            print(f"{file}: {', '.join(e.name for e in entries)} calibrated")
        print(f"written to {self.out}; open {self.out / 'report.html'}")
        return 0


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

"""Third stage, T1's: the trajectory outward over each image at two distances."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, JointVector
from armsight.calibration import arm, se3
from armsight.calibration.calibrate import Calibration
from armsight.calibration.live.log import Log, best_views, go, look, report, solve_now
from armsight.calibration.live.seen import Request, SeenView
from armsight.calibration.live.setup import board_middle, lens_list
from armsight.calibration.live.tilt import tilted
from armsight.calibration.views import board_in_view
from armsight.geometry.pose import inverse, make_pose


@dataclass(frozen=True)
class PaperSchedule:
    """T1's trajectory before one camera.

    Attributes:
        distance: of the first pass [m]; farther: factor of the second.
        stages: rings outward from the image's centre; overlap: boards may overlap between places.
        tilts: views a place, tilted each way in turn; 0 keeps the board parallel to the image.
        solve_every: views between refinements of the running estimate.
    """

    distance: float = 0.85
    farther: float = 1.2
    stages: int = 2
    overlap: bool = False
    tilts: int = 1
    solve_every: int = 4

    def views(self, limits: Floats) -> list[tuple[Floats, float, Floats]]:
        """(place in the image -1..1, distance [m], tilt [rad]) of each view, in order.

        Args:
            limits: (3, 2) greatest tilts about x, y, z, negative and positive [rad].
        """
        out = []
        turn = 0
        for factor in (1.0, self.farther):
            for ring in range(self.stages + 1):
                count = 1 if ring == 0 else (8 if self.overlap else 4) * ring
                for k in range(count):
                    angle = 2 * np.pi * (k + 0.5 * (ring % 2)) / count
                    r = 0.75 * ring / max(self.stages, 1)
                    place = r * np.array([np.cos(angle), np.sin(angle)])
                    tilts = [np.zeros(3)]
                    if self.tilts:
                        tilts = []
                        for _ in range(self.tilts):
                            axis, side = (0, 1, 2)[turn % 3], (turn // 3) % 2
                            t = np.zeros(3)
                            t[axis] = 0.8 * limits[axis, side]
                            tilts.append(t)
                            turn += 1
                    out += [(place, self.distance * factor, t) for t in tilts]
        return out


def cover(log: Log, answer: Calibration) -> Generator[Request, object, None]:
    """T1's staged trajectory: outward from the centre, again 20 % farther, camera by camera."""
    schedule = PaperSchedule()
    for rig, view in sorted(best_views(log).items()):
        name = log.setup.cameras[rig].name
        limits = yield from tilt_limits(log, rig, view)
        for place, distance, tilt in schedule.views(limits):
            q = _show_at(log, answer, rig, place, distance, tilt)
            if q is None or not (yield from go(log, q, "cover")):
                continue
            yield from look(log, "cover")
            if len(log.views) % schedule.solve_every == 0:
                answer = solve_now(log, np.random.default_rng(len(log.views)))
            report(log, f"covering the image of camera {name}", answer)


def tilt_limits(log: Log, rig: int, view: SeenView) -> Generator[Request, object, Floats]:
    """(3, 2) greatest tilts, negative and positive, in 5 deg steps until detection fails [rad]."""
    lenses = lens_list(log.setup.cameras)
    limits = np.zeros((3, 2))
    step = np.deg2rad(5)
    for axis in (2, 0, 1):
        for side, sign in ((0, -1.0), (1, 1.0)):
            most = np.deg2rad(45)
            for k in range(1, round(most / step) + 1):
                q = tilted(log, view, axis, sign * k * step)
                if q is None or not (yield from go(log, q, "tilt")):
                    break
                seen = yield from look(log, "tilt")
                if not any(lenses[i].rig == rig for i, _, _ in seen.found):
                    break
                limits[axis, side] = sign * k * step
    return limits


def _show_at(
    log: Log, answer: Calibration, rig: int, place: Floats, distance: float, tilt: Floats
) -> JointVector | None:
    """Joint angles that show the board at a place of a camera's image (shares of its half size)."""
    setup = log.setup
    lens_index = answer.main_lens(rig)
    lens = answer.lens(lens_index)
    u = np.array(
        [[(0.5 + 0.5 * place[0]) * (lens.width - 1), (0.5 + 0.5 * place[1]) * (lens.height - 1)]]
    )
    ray = np.append(lens.normalise(u)[0], 1.0)
    turn = se3.exps(np.array([[0, 0, 0, *tilt]]))[0]
    T = make_pose(None, ray * distance) @ turn @ make_pose(None, -board_middle(setup))
    flange = (
        answer.camera_pose(rig) @ answer.lens_pose(lens_index) @ T @ inverse(answer.board_pose())
    )
    near = log.at if log.at is not None else setup.robot.home
    q, ok = arm.reach(setup.robot, flange[None], near[None])
    if not ok[0]:
        return None
    inside, _ = board_in_view(
        answer.problem, answer.solution.state, arm.flange_poses(setup.robot, q), lens_index, 6.0
    )
    return q[0] if inside[0] else None

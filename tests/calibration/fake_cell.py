"""A calibration cell without pictures: what a picture would show is looked up by its number."""

from dataclasses import replace

import numpy as np

from armsight.calibration import se3
from armsight.calibration.boards import Detection, Miss
from armsight.calibration.live.seen import Picture
from armsight.calibration.live.setup import CameraSetup, Setup
from armsight.calibration.model import project
from armsight.calibration.synthetic import corners_in_lens, make_cell, seen_by, true_flanges
from armsight.calibration.views import travel_seconds
from armsight.geometry.camera import PinholeCamera


class NumberedBoard:
    """Finds in a picture what was put down under the picture's number."""

    def __init__(self, points):
        self.points = points
        self.shown = []

    def show(self, found):
        self.shown.append(found)
        return np.full((2, 2), len(self.shown) - 1, np.int64)

    def detect(self, gray):
        return self.shown[int(gray[0, 0])]

    def describe(self):
        return "numbered board"


def bare(lens):
    """A lens as its maker's sheet has it."""
    return PinholeCamera(lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy, (0.0,) * 5)


class FakeCell:
    """Arm that jumps, cameras that know where the corners are; blind: cameras that see nothing."""

    def __init__(self, robot, seed=0, levels=None, cameras=None, blind=(), free=None, move=None):
        rng = np.random.default_rng(seed)
        self.truth = make_cell(robot, rng, levels, cameras)
        self.rng = np.random.default_rng((seed, 1))
        self.board = NumberedBoard(self.truth.points)
        self.blind = dict.fromkeys(blind, "black") if not isinstance(blind, dict) else blind
        self.q, self.time, self.looks = np.array(robot.home), 0.0, 0
        cameras = []
        for rig, r in enumerate(self.truth.sheet.rigs):
            lenses = [lens for lens in self.truth.sheet.lenses if lens.rig == rig]
            cameras.append(
                CameraSetup(
                    r.name, bare(lenses[0].camera), bare(lenses[1].camera), lenses[1].T_rig_lens
                )
            )
        self.setup = Setup(
            robot, tuple(cameras), self.board, self.truth.T_flange_board_guess, free, None
        )
        self._refuses = move

    def move(self, joints):
        if self._refuses is not None and self._refuses(joints):
            return False
        self.time += float(travel_seconds(self.setup.robot, self.q, joints[None], 0.5, 0.6)[0])
        self.q = np.array(joints)
        return True

    def joints(self):
        return self.q.copy()

    def now(self):
        return self.time

    def look(self, cameras, rest, frames):
        self.time += rest + frames / 15
        self.looks += 1
        flange = true_flanges(self.truth, self.q[None], self.rng)
        pictures = []
        for rig in cameras:
            shown = []
            for k, lens in enumerate(self.truth.sheet.lenses):
                if lens.rig == rig:
                    shown.append(self.board.show(self._seen(flange, k, rig)))
            pictures.append(Picture(shown[1], shown[0], None))
        return pictures

    def _seen(self, flange, lens, rig):
        name = self.truth.sheet.rigs[rig].name
        if name in self.blind:
            return Miss(self.blind[name])
        p = corners_in_lens(self.truth, flange, lens)
        pixel = project(p, self.truth.state.lens[lens][None], False)[0]
        if not seen_by(p, pixel, self.truth.sheet.lenses[lens].camera)[0]:
            return Miss("no board found")
        noise = self.rng.normal(0, 0.1, pixel[0].shape)
        return Detection(np.arange(pixel.shape[1]), pixel[0] + noise, 0.1)


def upside_down(cameras, which):
    """The same cameras, one of them turned by 180 deg about its view."""
    turn = se3.exps(np.array([[0, 0, 0, 0, 0, np.pi]]))[0]
    return tuple(
        replace(c, T_base_camera=c.T_base_camera @ turn) if c.name == which else c for c in cameras
    )

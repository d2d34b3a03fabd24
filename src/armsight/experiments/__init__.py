"""One module a table of the papers, ours beside theirs.

``armsight experiment NAME`` looks a name up here and imports that module alone.
"""

from __future__ import annotations

import difflib
from importlib import import_module
from typing import TYPE_CHECKING

from armsight.errors import UsageError

if TYPE_CHECKING:
    from armsight.experiments.frame import Experiment

NAMES: dict[str, str] = {
    "patrol-smoke": "60 simulated seconds of guarded patrol, a person reaching in",
    "wall-loop": "commands under the wall clock: how evenly they come, alone and beside others",
    "danger-map": "T2: danger of three circles, decay at any rate, forecast of the next 2 s",
    "patrol": "T2: A-B-A, reactive beside ours, the same obstacle for all",
    "approach": "people reach in at up to 2 m/s; a search tries to force a contact",
    "mbm": "MotionBenchMaker's problems through depth pictures, paths checked at 1 mm",
    "things": "things beside the arm's way, and left there by a person, told from people",
    "things-search": "people who try to be taken for a thing, or for nobody, in made-up worlds",
    "faults": "lying cameras, clocks, joints, maps and disks in a running cell, and kills",
    "mutants": "mistakes in the guard's and the map's code, and the tests that notice them",
    "permit": "touches by permit: how hard they really press, whatever goes wrong",
    "approach-permit": "people reach for an arm that touches something by permit",
    "false-stops": "stops with nobody near, under sensor, stamp and calibration errors",
    "calibration-intrinsics": "T1: lenses, nine experiments of fewer and fewer frames",
    "calibration-eye-to-hand": "T1: three cameras in the base, five experiments",
    "calibration-peers": "calibration beside the bound and OpenCV, same corners; ellipsoids",
    "calibration-sphere": "V: fixed cameras registered by a sphere that the arm carries",
    "calibration-drift": "drift watch: moved cameras named, cells that stand still left alone",
    "own-arm": "cameras placed by their own arm, from depth and from colour",
    "bump": "a camera of a running cell is walked into, and calibrated again from the arm",
    "any-arm": "any arm in one colour picture: type, mask, joints, and how sure",
    "extend": "a robot that the shipped network never saw, from some hundred crops",
    "recognition": "T4 to T7: the robot in one colour image, the papers' four networks",
    "calibration-strangers": "calibration on other people's data: layouts, mistakes, honesty",
    "servo-registration": "V: errors of points over the table, fixed cameras registered",
    "servo-accuracy": "V: accuracy of the fixed cameras at a moving ball, tracking, gaps, switches",
    "servo-straw": "V: a straw to a mouth that moves, with contact, ours beside V's mode",
    "servo-handover": "V: an item let go above a palm that moves, ours beside V's two modes",
    "servo-bullseye": "V: docking with a bulls-eye, ours beside V's two modes",
    "servo-loop": "V: how soon a step of the target changes the command, and what a round costs",
    "servo-ball": "V: touching a ball at rest and moving, ours beside V's two modes",
    "port-detection": "T3: charging ports found in one picture: speed, recall, false alarms",
    "port-pose": "T3: the pose of a port by a converging pair, beside the paper's plane",
    "insertion": "T3: plugging in and out by force, beside the paper's halt",
    "lid": "T3: a charging lid opened and shut by feel",
    "charging": "T3: visits of the charging station, cars parked at random",
    "charging-guarded": "T3: visits of the whole guarded cell, with somebody about",
    "station-kill": "T3: the charging station killed in every phase, and started again",
    "station-kill-guarded": "T3: the whole charging program killed likewise",
    "plug-calibration": "T3: calibration without a marker, the plug before the pair",
    "calibration-real": "real hand-eye sets, beside the figures published with them",
}
"""Every experiment and its help; the module of ``a-b`` is ``armsight.experiments.a_b``."""


def load_experiment(name: str) -> Experiment:
    """The experiment of a name.

    Raises:
        UsageError: there is none; names those that there are.
    """
    if name not in NAMES:
        close = difflib.get_close_matches(name, NAMES, n=1)
        hint = f'did you mean "{close[0]}"? ' if close else ""
        raise UsageError(f'unknown experiment "{name}"; {hint}known: {", ".join(NAMES)}')
    module = import_module(f"armsight.experiments.{name.replace('-', '_')}")
    experiment: Experiment = module.EXPERIMENT
    return experiment

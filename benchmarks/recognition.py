"""One colour picture of 1280 x 720 to every joint in 3D: ``armsight recognise``, by parts.

Pictures of the training's renderer (rooms, arms and lenses of the wild, each of the five robots in
turn), the shipped network, both stages and the solver; all cores, then one. There is no peer to
install that finds joints of an unknown arm without its angles; the parts say where the time goes.
"""

from __future__ import annotations

import tempfile
from itertools import cycle
from pathlib import Path

from armsight.geometry.camera import PinholeCamera
from armsight.recognition.any_arm.best_outline import best_outlined
from armsight.recognition.any_arm.edges import at_edges
from armsight.recognition.any_arm.frames import find_lumps
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.any_arm.observing import observe
from armsight.recognition.any_arm.recogniser import COMPARED, ArmRecogniser
from armsight.recognition.any_arm.solver import solve
from armsight.recognition.data.generate import generate
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.data.order import make_order
from armsight.recognition.data.sample import KNOWN_ROBOTS
from armsight.recognition.inference.model import network_file
from armsight.recognition.inference.pictures import Picture
from armsight.robots.catalogue import load_robot
from common import Report, measure

SIZE = (1280, 720)
SEED = 902


def main() -> None:
    """Measure everything."""
    report = Report("recognition", __doc__)
    order = make_order("wild", dict.fromkeys(KNOWN_ROBOTS, 3), SEED, SIZE)
    with tempfile.TemporaryDirectory() as folder:
        generate(order, Path(folder))
        made = LabelledSet.open(Path(folder))
        frames = [(Picture("frame", s.image), s.camera) for s in made]
    rounds = report.rounds(3 * len(frames))
    for name, threads in (("image_ms", 0), ("image_one_thread_ms", 1)):
        recogniser = ArmRecogniser(CropModel(network_file("arms"), threads))
        turn = cycle(frames)
        timing = measure(
            lambda recogniser=recogniser, turn=turn: recogniser.recognise(*next(turn)),
            rounds=rounds,
            warmup=len(frames),
        )
        report.add(
            name,
            1e3 * timing.median,
            "ms",
            spread=timing.spread_ms,
            note=f"{1e3 * timing.cpu_per_round:.0f} ms of CPU a picture",
            **({"must": "<= 120", "aim": "<= 60"} if threads == 0 else {}),
        )
    _parts(report, frames, rounds)
    report.finish()


def _parts(report: Report, frames: list[tuple[Picture, PinholeCamera]], rounds: int) -> None:
    """Where the time goes, on the first picture in which an arm is found, one thread."""
    model = CropModel(network_file("arms"), 1)
    recogniser = ArmRecogniser(model)
    for picture, lens in frames:
        lumps = find_lumps(model, picture.image)[0]
        if lumps and recogniser.examined(picture.image, lens, lumps[0].low, lumps[0].high):
            break
    lump = lumps[0]
    look, crop = recogniser.looked(picture.image, lens, lump.low, lump.high)
    name = max(model.robots, key=lambda robot: look.types[robot])
    robot, marks = load_robot(name), model.landmarks[name]
    seen = observe(look, crop, name, marks)
    sharp = at_edges(look.arm, crop.image)
    fits = solve(robot, marks, seen)[:COMPARED]
    parts = {
        "find_lumps_ms": lambda: find_lumps(model, picture.image),
        "two_looks_ms": lambda: recogniser.looked(picture.image, lens, lump.low, lump.high),
        "edges_ms": lambda: at_edges(look.arm, crop.image),
        "solve_ms": lambda: solve(robot, marks, seen),
        "outlines_ms": lambda: best_outlined(fits, seen, sharp, crop),
    }
    for key, part in parts.items():
        timing = measure(part, rounds=rounds, warmup=3)
        report.add(key, 1e3 * timing.median, "ms", spread=timing.spread_ms, note="one thread")


if __name__ == "__main__":
    main()

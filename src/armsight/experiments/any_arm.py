"""Any arm in one colour picture, angles unknown: ours beside a network of the papers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from armsight.errors import ArmsightError
from armsight.experiments.any_arm_frames import (
    Frame,
    baseline_frame,
    set_of,
    try_frame,
)
from armsight.experiments.any_arm_pictures import skeletons
from armsight.experiments.frame import Draw, Experiment, Outcome, Progress
from armsight.experiments.recognition_scores import folder
from armsight.experiments.rows import Row, wilson
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.any_arm.recogniser import ArmRecogniser
from armsight.recognition.data import LabelledSet
from armsight.recognition.data.sample import KNOWN_ROBOTS, NO_ROBOT, UNKNOWN_ROBOT
from armsight.recognition.inference.model import Model, network_file
from armsight.recognition.inference.recogniser import Recogniser

NETWORK, BASELINE = "arms", "t7-rooms-on"
FAR = 0.3
"""Beyond an arm's reach by so much, nobody has to be warned [m]."""
SETS = {
    "second-rooms": "second renderer, 640 x 480, base at 1.2 to 2.5 m, box not given",
    "third-rooms": "third renderer, 640 x 480, base at 1.2 to 2.5 m, box not given",
}
"""Folders of the frames that figures are given for, and what their rows say."""
EMPTY = "-empty"
"""End of the folders of more empty pictures: thirty do not tell 0.95 from 0.9."""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """The shipped network on at most ``runs`` frames of each type and renderer."""
    recogniser = ArmRecogniser(CropModel(network_file(NETWORK), 1))
    rows: list[Row] = []
    notes = [NOTE]
    plots: dict[str, Draw] = {}
    old = None
    try:
        old = Recogniser(Model(folder() / "runs" / BASELINE / "network.onnx", 1))
    except ArmsightError as error:
        notes.append(f"No network of the papers was there to compare with: {_within(error)}")
    for turn, (name, where) in enumerate(SETS.items()):
        try:
            held = LabelledSet.open(set_of(name), partial=True)
        except ArmsightError as error:
            notes.append(f"Not there: {_within(error)}")
            continue
        chosen = _chosen(held, runs, seed)
        looked_at = [(held, i) for i in chosen]
        try:
            more = LabelledSet.open(set_of(name + EMPTY), partial=True)
            looked_at += [(more, i) for i in range(len(more.rows))]
        except ArmsightError as error:
            notes.append(f"Not there: {_within(error)}")
        frames = []
        for k, (some, i) in enumerate(looked_at):
            progress(where.partition(",")[0], (turn + k / len(looked_at)) / len(SETS))
            frames.append(try_frame(recogniser, some[i]))
        rows += _rows(frames, where)
        plots[f"frames-{name}"] = partial(skeletons, recogniser, held, chosen)
        if old is not None:
            rows += _baseline([baseline_frame(old, held[i]) for i in chosen], where)
    if not rows:
        raise ArmsightError(notes[-1])
    return Outcome(tuple(rows), plots, tuple(notes))


def _within(error: ArmsightError) -> str:
    """What is wrong with a file of :func:`folder`, without where on this machine that is."""
    return str(error).removeprefix(f"{folder()}/")


NOTE = (
    "Every frame counts: one without an answer, or with the type of an arm with another number of "
    "joints, is off by more than any bound. The second renderer is Mitsuba, the third Blender's "
    "Cycles: two path tracers with rooms, materials, lights, tools and lenses of their own; the "
    "network learned from crops of MuJoCo's renderer alone. Nothing was ever chosen by frames of "
    "the third. Trust, threshold and the factor of the covariances come from crops of that "
    "renderer that were held back from training, and from tuning frames of the second one (other "
    "seeds; the network's card says how many). `known_` keys have box and joint angles given. "
    "`baseline_` keys are the multi-objective network of T7, trained on rooms, on the same frames. "
    "The pictures show the first two frames of each robot, angles unknown above and given below."
)


def _chosen(held: LabelledSet, most: int, seed: int) -> list[int]:
    names = np.array([row.robot for row in held.rows])
    found: list[int] = []
    for name in dict.fromkeys(names.tolist()):
        mine = np.flatnonzero(names == name)
        order = np.random.default_rng([seed, 53]).permutation(mine)[:most]
        found += sorted(int(i) for i in order)
    return found


def _rows(frames: Sequence[Frame], where: str) -> list[Row]:
    share = partial(_share_in, where)
    known = [f for f in frames if f.robot in KNOWN_ROBOTS]
    strange = [f for f in frames if f.robot == UNKNOWN_ROBOT]
    empty = [f for f in frames if f.robot == NO_ROBOT]
    sure = [f for f in known if f.believed]
    error = np.array([f.error for f in known])
    marks = np.concatenate([f.landmarks for f in known]) if known else np.empty(0)
    inside = np.array([f.inside for f in sure if np.isfinite(f.inside)])
    n = len(known)
    rows = [
        Row("mask_iou", "mask, intersection over union, mean over frames with one of the five",
            where, _mean([f.iou for f in known]), "", n, must=0.75, aim=0.93, better="higher"),
        Row("unknown_mask_iou", "the same, arms that nobody sells", where,
            _mean([f.iou for f in strange]), "", len(strange), better="higher"),
        share("type_accuracy", "right type, of the five robots of any paint",
              [f.said == f.robot for f in known], 0.85, 0.99),
        share("unknown_recall", "arms that nobody sells called unknown",
              [f.said == UNKNOWN_ROBOT for f in strange], 0.5, 0.9),
        share("none_recall", "empty pictures said to be empty",
              [f.said == NO_ROBOT for f in empty], 0.95, 0.99),
        share("overlooked", "pictures of the five said to be empty",
              [f.said == NO_ROBOT for f in known], None, None, better="lower"),
        Row("keypoint_px", "visible landmarks in a crop of 160 px, box given, median", where,
            _median(marks), "px", len(marks), must=3.5, aim=1.0),
        Row("joint_median_mm", "mean joint error of a frame, median over frames", where,
            _median(error), "mm", n, must=100.0, aim=18.0),
        share("joint_over_100", "frames off by more than 100 mm", list(error > 100.0), 0.5, 0.04,
              better="lower"),
        Row("known_joint_median_mm", "the same, joint angles and box known, no start", where,
            _median(np.array([f.known for f in known])), "mm", n, must=40.0, aim=8.0),
        share("confident_share", "answers that pass their own check, of the five",
              [f.believed for f in known], 0.4, 0.9),
        share("confident_wrong", "of these, off by more than 100 mm or of another type",
              [f.error > 100.0 or f.said != f.robot for f in sure], 0.15, 0.01, better="lower"),
        Row("coverage_90", "of these, joints 2 to 5 in their 90 % ellipsoid", where,
            _mean(list(inside)), "", 4 * len(inside), must=0.8, aim=0.87, better="higher",
            why="no answer is believed"),
        Row("image_cpu_ms", "processor time of a whole picture of 640 x 480, one thread, median",
            where, 1e3 * _median(np.array([f.cpu for f in frames])), "ms", len(frames)),
        *_reach_rows(known, where),
    ]  # fmt: skip
    rows += [
        Row("robot_joint_median_mm", "mean joint error, median over the frames of one robot",
            f"{where}; {name}", _median(np.array([f.error for f in mine])), "mm", len(mine))
        for name in KNOWN_ROBOTS if (mine := [f for f in known if f.robot == name])
    ]  # fmt: skip
    return rows


def _reach_rows(known: Sequence[Frame], where: str) -> list[Row]:
    """Whether somebody who carries the camera is warned."""
    share = partial(_share_in, where)
    true, said, least = np.array([f.reach for f in known]).reshape(-1, 3).T
    told = np.isfinite(said)
    far = true > FAR
    return [
        Row("reach_mm", "camera to what the arm can reach: error, median over the answers that say",
            where, 1e3 * _median(np.abs(said - true)[told]), "mm", int(told.sum())),
        share("reach_overstated", "said to be farther from the reach, at least, than it is",
              list(least[told] > true[told]), None, None, better="lower"),
        share("reach_clear", f"cameras {FAR} m and more beyond the reach of which that is said",
              list(least[far] > 0.0), None, None),
        share("reach_missed", "cameras within the reach, said to be beyond or no arm seen",
              [f.said == NO_ROBOT or f.reach[2] > 0.0 for f in known if f.reach[0] < 0.0],
              None, None, better="lower"),
    ]  # fmt: skip


def _baseline(frames: Sequence[Frame], where: str) -> list[Row]:
    share = partial(_share_in, where)
    known = [f for f in frames if f.robot in KNOWN_ROBOTS]
    empty = [f for f in frames if f.robot == NO_ROBOT]
    error = np.array([f.error for f in known])
    return [
        Row("baseline_mask_iou", "the papers' network: mask", where,
            _mean([f.iou for f in known]), "", len(known), better="higher"),
        share("baseline_type_accuracy", "the papers' network: right type",
              [f.said == f.robot for f in known], None, None),
        share("baseline_none_recall", "the papers' network: empty pictures said to be empty",
              [f.said == NO_ROBOT for f in empty], None, None),
        Row("baseline_joint_median_mm", "the papers' network: joint error, median", where,
            _median(error), "mm", len(known)),
        share("baseline_joint_over_100", "the papers' network: frames off by more than 100 mm",
              list(error > 100.0), None, None, better="lower"),
    ]  # fmt: skip


def _share_in(
    where: str,
    key: str,
    words: str,
    hits: Sequence[bool],
    must: float | None,
    aim: float | None,
    better: str = "higher",
) -> Row:
    n = len(hits)
    value = float(np.mean(hits)) if n else float("nan")
    low, high = wilson(int(np.sum(hits)), n) if n else (None, None)
    return Row(
        key, words, where, value, "", n, low=low, high=high, must=must, aim=aim,
        better="higher" if better == "higher" else "lower", why="no such frame",
    )  # fmt: skip


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float("nan")


EXPERIMENT = Experiment(
    "any-arm",
    "Any arm in one colour picture, joint angles unknown",
    run,
    40,
    "The shipped network, its crops, the kinematic solver and its own judgement, on frames of the "
    "second and the third renderer (`scripts/renderers`: `--set wild --size 640x480 --distance 1.2 "
    "2.5`, with `--samples 6 --seed 5` and `--seed 7`, in `results/recognition/sets/second-rooms` "
    "and `third-rooms`). `--runs` is the number of frames of each type and renderer at most.",
)

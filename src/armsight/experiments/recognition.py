"""T4 to T7: the robot in one colour image, the papers' four networks beside their tables."""

from __future__ import annotations

import importlib.util
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Floats
from armsight.experiments.frame import Draw, Experiment, Outcome, Progress
from armsight.experiments.recognition_scores import (
    UNSEEN,
    Bench,
    Tried,
    folder,
    mask_shares,
    milliseconds,
    training_curve,
)
from armsight.experiments.rows import Row, bootstrap, wilson
from armsight.recognition.data.sample import NO_ROBOT
from armsight.recognition.inference.model import Model
from armsight.recognition.metrics import add_auc, against, mask_iou, recognised, share_over
from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.training import curves
from armsight.recognition.training.figures import Scores

if TYPE_CHECKING:
    from matplotlib.figure import Figure

URS = ("ur3", "ur5", "ur10")
GROUPS = {"UR": URS, "KUKA": ("iiwa",), "Panda": ("panda",)}
SAMPLE_COUNTS = {"t6": (100, 200, 312, 600, 1200, 1800), "t7": (100, 250, 500, 750)}
EDGES = np.array([1.2, 1.4, 1.6, 1.8, 2.0, 2.25, 2.5])
"""[m]; distances of T7's figure 5."""
PAPERS = {"t4": ("ur5",), "t5": URS, "t6": ("iiwa",), "t7": (*URS, "iiwa", "panda")}
GROUNDS = ("", "-rooms")
"""Trained on the papers' recordings, and on one room a picture."""
LEAST = 5
"""Frames that a bin or a curve needs."""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """Every trained network that is there, on at most ``runs`` test frames of each robot."""
    bench = Bench(runs, seed, progress)
    rows: list[Row] = []
    tried: dict[str, list[Tried]] = {}
    for ground in GROUNDS:
        for paper, robots in PAPERS.items():
            model = bench.model(paper + ground)
            tried[paper + ground] = bench.tries(model, robots) if model is not None else []
    t4, t5, t6, t7 = ([t for g in GROUNDS for t in tried[p + g]] for p in PAPERS)
    rows += _t4(t4) + _t4_separate(t4) + _t5(t5) + _t6(t6) + _t7(t7) + _forgetting(t7, t5)
    for name, of in tried.items():
        for t in of:
            rows += _common(name[:2], t, seed)
    by_samples = _by_samples(bench)
    rows += _against_distance(t7) + by_samples + _no_robot(bench, tried) + _nearest(bench, tried)
    rows += _trained(tried) + _speed(tried)
    plots: dict[str, Draw] = {
        f"overlays-{name}": partial(overlays, t) for name, of in tried.items() for t in of if t.own
    }
    for name, of in tried.items():
        curve = training_curve(name)
        if of and curve:
            stages = [s["name"] for s in of[0].model.card["training"]["stages"]]
            plots[f"curve-{name}"] = partial(curves.figure, curve, stages)
    if t7 or t5:
        plots["distance"] = lambda: distance_plot(t7 or t5)
    if by_samples:
        plots["samples"] = partial(samples_plot, by_samples)
    return Outcome(tuple(rows), plots, (*_notes(tried, bench), *NOTES))


NOTES = (
    "Every frame counts; a network of the papers has an answer for each. `_mask_accuracy` is the "
    "share of right pixels, which an empty mask drives above 90 % where the robot is small; "
    "`_mask_iou` says more. Masks are compared at the network's own size. Errors are distances in "
    "three dimensions, in the camera's frame, of joint origins and base. ADD-AUC is the area under "
    "the share of frames with a mean joint error below t, t to 100 mm.",
    "`t6_minutes` is the time to the accuracy that T6 must have, and `t7_forgetting` the worsening "
    "of a network that has the accuracy of T7: both are missed where the accuracy is, since little "
    "is learned in a minute, and who knows nothing forgets nothing. The bare figures are "
    "`t6_training_minutes` and `t7_worsening`. `_joint_mm_guess` is what the best constant answer "
    "would score: a network that is not well "
    "below it has learned nothing of where the robot is. `_nearest_mm` is what knowing the "
    "training frames by heart could reach: the camera of a recording stands, and its frames are "
    "split at random, so that most test frames of the URs have a training frame with the very "
    "same joints, but for the last, which moves no origin.",
    "Wild pictures have a lens each; they are taken through the network's own camera, as "
    "`recognise` does with the intrinsics that it is given.",
    "Two grounds. *Trained on recordings* is the papers' way: as many frames of as few recordings, "
    "in each of which the camera stands still (but the Panda's) while the arm sweeps its joints; "
    "frames of seen recordings are what the papers' figures are on. *Trained on rooms* is ours: "
    "every picture in a room and from a camera of its own. Budgets hold in unseen scenes. The "
    "pictures are rendered, not photographs.",
)


def _t4(tried: list[Tried]) -> list[Row]:
    rows = []
    for t in _or_nothing(tried):
        s = t.scores if t else None
        bounds = _bounds(t)
        rows += [
            Row("t4_mask_accuracy", "T4, UR5: share of the pixels that are right",
                _of(t), _mean(s, "accuracy", 100), "%", _n(s), paper=98.1, better="higher",
                **bounds(95.0, 98.1)),
            Row("t4_joint_mean_mm", "T4, UR5: mean joint error of the full system",
                _of(t), _mean(s, "add", 1e3), "mm", _n(s), paper=24.2, **bounds(40.0, 24.2)),
        ]  # fmt: skip
    return rows


def _t4_separate(tried: list[Tried]) -> list[Row]:
    """T4's coordinate network by itself, on true masks, from the card."""
    rows = []
    for t in (t for t in tried if t.own):
        figures = t.model.card["validation"].get("ur5, true masks")
        if figures:
            where = f"{t.condition}, validation frames; true masks"
            n = int(figures["frames"])
            rows += [
                Row("t4_separate_joint_mean_mm", "T4, UR5: mean joint error of the coordinate "
                    "network on true masks", where, figures["joint_mean_mm"], "mm", n, paper=20.2),
                Row("t4_separate_base_mean_mm", "T4, UR5: mean base error of the same", where,
                    figures["base_mean_mm"], "mm", n),
            ]  # fmt: skip
    return rows


def _t5(tried: list[Tried]) -> list[Row]:
    rows = []
    for t in _or_nothing(tried):
        s = t.scores if t else None
        bounds = _bounds(t)
        low, high = _type_bounds(s)
        rows += [
            Row("t5_mask_accuracy", "T5, three URs: share of the pixels that are right",
                _of(t), _mean(s, "accuracy", 100), "%", _n(s), paper=98.0, better="higher",
                **bounds(95.0, 98.0)),
            Row("t5_mask_iou", "T5: intersection over union of the mask, mean over frames",
                _of(t), _mean(s, "iou"), "", _n(s), better="higher", **bounds(0.75, None)),
            Row("t5_type_accuracy", "T5: share of the frames with the right type", _of(t),
                _type(s), "%", _n(s), low=low, high=high, paper=98.3, better="higher",
                **bounds(95.0, 98.3)),
            Row("t5_joint_mean_mm", "T5: mean joint error", _of(t), _mean(s, "add", 1e3), "mm",
                _n(s), paper=31.6, **bounds(45.0, 31.6)),
            Row("t5_base_mean_mm", "T5: mean base error", _of(t), _mean(s, "base", 1e3), "mm",
                _n(s), paper=27.4, **bounds(40.0, 27.4)),
        ]  # fmt: skip
        if s is None or t is None:
            continue
        rows += [
            Row("t5_base_median_mm", "T5: median base error", _of(t), _median(s.base), "mm",
                _n(s), paper=21.3),
            *(Row("t5_joint_error_mm", "T5, figure 4b: mean error of one joint",
                  f"{_of(t)}; joint {k + 1}", 1e3 * float(np.mean(s.joints[:, k])), "mm", _n(s))
              for k in range(6)),
            *(Row("t5_robot_joint_mean_mm", "T5: mean joint error of one robot",
                  f"{_of(t)}; {r}", _mean(s.of(s.robot == r), "add", 1e3), "mm",
                  int((s.robot == r).sum()))
              for r in URS if (s.robot == r).any()),
        ]  # fmt: skip
    return rows


def _t6(tried: list[Tried]) -> list[Row]:
    rows = []
    minutes, where = np.nan, ""
    for t in _or_nothing(tried):
        s = t.scores if t else None
        bounds = _bounds(t)
        error = Row("t6_joint_median_mm", "T6, iiwa: median joint error", _of(t),
                    _median(s.add) if s else np.nan, "mm", _n(s), paper=28.7,
                    **bounds(45.0, 28.7))  # fmt: skip
        rows.append(error)
        if t is None or s is None:
            continue
        rows += [
            Row("t6_base_median_mm", "T6, iiwa: median base error", _of(t), _median(s.base),
                "mm", _n(s), paper=20.2),
            Row("t6_mask_accuracy", "T6, iiwa: share of the pixels that are right", _of(t),
                _mean(s, "accuracy", 100), "%", _n(s), paper=97.3, better="higher"),
        ]  # fmt: skip
        if error.met:
            card = t.model.card["training"]
            minutes = card["seconds"] / 60
            where = f"{_of(t)}; {card['device']}, {card['threads']} thread(s)"
    rows.append(
        Row("t6_minutes", "T6: training time, without that of T5, to the joint error that it must "
            "have", where, minutes, "min", int(bool(where)), paper=120.0, must=60.0, aim=15.0,
            why="not reached: the joint error that it must have")
    )  # fmt: skip
    return rows


T7_JOINT_MUST = 50.0
"""[mm], median."""
_T7_PAPER = {
    "UR": (97.0, 97.5, 31.2, 24.2),
    "KUKA": (97.7, 100.0, 33.0, 23.6),
    "Panda": (94.3, 96.1, 36.4, 30.1),
}


def _t7(tried: list[Tried]) -> list[Row]:
    rows = []
    for t in _or_nothing(tried):
        bounds = _bounds(t)
        types: list[float] = []
        for group, robots in GROUPS.items():
            s = t.scores.of(np.isin(t.scores.robot, robots)) if t else None
            s = s if s is not None and len(s.add) else None
            where = f"{_of(t)}; {group}" if t else group
            paper = _T7_PAPER[group]
            low, high = _type_bounds(s)
            types += [_type(s)] if s else []
            rows += [
                Row("t7_mask_accuracy", "T7: share of the pixels that are right", where,
                    _mean(s, "accuracy", 100), "%", _n(s), paper=paper[0], better="higher"),
                Row("t7_type_accuracy", "T7: share of the frames with the right type", where,
                    _type(s), "%", _n(s), low=low, high=high, paper=paper[1], better="higher"),
                Row("t7_joint_median_mm", "T7: median joint error", where,
                    _median(s.add) if s else np.nan, "mm", _n(s), paper=paper[2],
                    **bounds(T7_JOINT_MUST, paper[2])),
                Row("t7_base_median_mm", "T7: median base error", where,
                    _median(s.base) if s else np.nan, "mm", _n(s), paper=paper[3]),
            ]  # fmt: skip
        # A network that always says the same is right about one of them.
        rows.append(
            Row("t7_type_accuracy", "T7: share of the frames with the right type",
                f"{_of(t)}; the worst of the three", min(types, default=np.nan), "%",
                _n(t.scores if t else None), paper=96.1, better="higher", **bounds(92.0, 96.1))
        )  # fmt: skip
    return rows


def _forgetting(tried: list[Tried], t5: list[Tried]) -> list[Row]:
    """Worsening of the old robots' mean joint error from T5 to T7, on the same frames."""
    rows = []
    counted, where, n = np.nan, "", 0
    before = {t.condition: t for t in t5}
    for t in tried:
        old = before.get(t.condition)
        if old is None:
            continue
        new = t.scores.of(np.isin(t.scores.robot, URS))
        worse = 100.0 * (float(np.mean(new.add)) / float(np.mean(old.scores.add)) - 1.0)
        rows.append(
            Row("t7_worsening", "T7: by how much the URs' mean joint error grew since T5, whatever "
                "it is", f"{t.condition}; URs", worse, "%", len(new.add))
        )  # fmt: skip
        if t.where == UNSEEN and not np.isfinite(counted):
            accurate = all(
                _median(s.add) <= T7_JOINT_MUST
                for robots in GROUPS.values()
                if len((s := t.scores.of(np.isin(t.scores.robot, robots))).add)
            )
            where, n = f"{t.condition}; URs", len(new.add)
            counted = worse if accurate else np.nan
    rows.append(
        Row("t7_forgetting", "T7: by how much the URs' mean joint error grew since T5, of a "
            "network that has the joint error that it must have", where, counted, "%", n, paper=0.0,
            must=20.0, aim=5.0, strict=True, why="not reached: the joint error that it must have")
    )  # fmt: skip
    return rows


def _common(name: str, t: Tried, seed: int) -> list[Row]:
    """Figures that every network has, on every set."""
    s, where = t.scores, _of(t)
    rng = np.random.default_rng([seed, 43])
    low, high = bootstrap((1e3 * s.add).tolist(), rng, "mean")
    base = _spread_of_frames(t)
    return [
        Row(f"{name}_add_auc", f"{name.upper()}: area under the ADD curve to 100 mm", where,
            add_auc(s.add), "", _n(s), better="higher"),
        Row(f"{name}_iou", f"{name.upper()}: mask, intersection over union", where,
            float(s.iou.mean()), "", _n(s), better="higher"),
        Row(f"{name}_iou_all_robot", f"{name.upper()}: IoU of a mask that is robot all over, "
            "for comparison", where, _full_mask_iou(t), "", _n(s)),
        Row(f"{name}_joint_mm", f"{name.upper()}: mean joint error, with its 95 % interval", where,
            1e3 * float(np.mean(s.add)), "mm", _n(s), low=low, high=high),
        Row(f"{name}_joint_mm_median", f"{name.upper()}: median joint error", where,
            _median(s.add), "mm", _n(s)),
        Row(f"{name}_joint_mm_guess", f"{name.upper()}: mean joint error of always answering the "
            "mean of these frames' own joints, for comparison", where, base, "mm", _n(s)),
        Row(f"{name}_over_100_mm", f"{name.upper()}: share of the frames off by more than 100 mm",
            where, 100.0 * share_over(s.add), "%", _n(s)),
        Row(f"{name}_recognised", f"{name.upper()}: share with the right type and within 100 mm",
            where, 100.0 * recognised(s.add, s.said, s.robot), "%", _n(s), better="higher"),
    ]  # fmt: skip


def _full_mask_iou(t: Tried) -> float:
    masks = t.data.masks(t.scores.samples)
    return float(mask_iou(np.ones_like(masks), masks).mean())


def _spread_of_frames(t: Tried) -> float:
    """Mean joint error of the best constant answer [mm]: what a network must beat."""
    joints = t.data.joints[t.scores.samples].astype(float)
    total: list[float] = []
    for robot in np.unique(t.scores.robot):
        mine = joints[t.scores.robot == robot]
        total += np.nanmean(np.linalg.norm(mine - mine.mean(axis=0), axis=-1), axis=1).tolist()
    return 1e3 * float(np.mean(total))


def _against_distance(tried: list[Tried]) -> list[Row]:
    rows = []
    for t in (t for t in tried if t.own):
        for group, robots in GROUPS.items():
            s = t.scores.of(np.isin(t.scores.robot, robots))
            for low, high, values in against(s.add, s.distance, EDGES):
                if len(values) >= LEAST:
                    rows.append(
                        Row("t7_joint_by_distance_mm", "T7, figure 5c: median joint error against "
                            "the distance of the base",
                            f"{t.condition}; {group}, {low:g} to {high:g} m",
                            _median(values), "mm", len(values))
                    )  # fmt: skip
    return rows


def _by_samples(bench: Bench) -> list[Row]:
    """T6's and T7's curves over the number of samples, of the trainings that are there."""
    rows = []
    for name, counts in SAMPLE_COUNTS.items():
        robots = ("iiwa",) if name == "t6" else (*URS, "iiwa", "panda")
        for count in counts:
            if not (folder() / "runs" / f"{name}-{count}" / "network.onnx").is_file():
                continue
            model = bench.model(f"{name}-{count}")
            assert model is not None
            for t in (t for t in bench.tries(model, robots) if t.own):
                training, used = model.card["training"], model.card["data"]["training_samples"]
                fewer = ", or all that there are" if min(used.values()) < count else ""
                where = f"{count} samples of each robot{fewer}; {_of(t)}"
                rows += [
                    Row(f"{name}_samples_joint_median_mm", f"{name.upper()}: median joint error "
                        "against the number of samples", where, _median(t.scores.add), "mm",
                        _n(t.scores)),
                    Row(f"{name}_samples_minutes", f"{name.upper()}: training time against the "
                        "number of samples", where, training["seconds"] / 60, "min"),
                ]  # fmt: skip
    return rows


def _nearest(bench: Bench, tried: dict[str, list[Tried]]) -> list[Row]:
    """What knowing the training frames by heart is worth: the nearest of as many as were used."""
    rows = []
    for name, t in ((name, t) for name, of in tried.items() for t in of if t.own):
        labelled = bench.labelled(t.set)
        assert labelled is not None
        data = t.model.card["data"]
        train = labelled.split("train", str(data.get("split", "frame")))  # type: ignore[arg-type]
        for robot, count in data["training_samples"].items():
            known = [i for i in train if labelled.rows[int(i)].robot == robot]
            asked = t.scores.samples[t.scores.robot == robot]
            if not known or not len(asked):
                continue
            picked = np.random.default_rng([43]).permutation(known)[:count]
            joints = np.stack([labelled.rows[int(i)].joints_camera for i in picked])
            truth = t.data.joints[asked, : joints.shape[1]].astype(float)
            errors = [np.linalg.norm(joints - one, axis=-1).mean(axis=1).min() for one in truth]
            rows.append(
                Row(f"{name[:2]}_nearest_mm", f"{name[:2].upper()}: median joint error of the "
                    "nearest of so many training frames, chosen knowing the answer, for "
                    "comparison", f"{t.condition}; {robot}, of {len(picked)}",
                    round(_median(np.array(errors)), 3), "mm", len(asked))
            )  # fmt: skip
    return rows


def _no_robot(bench: Bench, tried: dict[str, list[Tried]]) -> list[Row]:
    """How the networks of five robots tell pictures without one, where a set has such pictures."""
    rows = []
    for t in (t for name, of in tried.items() if name.startswith("t7") for t in of):
        labelled = bench.labelled(t.set)
        robots = np.array([row.robot for row in labelled.rows]) if labelled else np.array([])
        without = np.flatnonzero(robots == NO_ROBOT)
        if labelled is None or not len(without):
            continue
        shown = np.flatnonzero(np.isin(robots, t.model.architecture.robots))
        for key, words, samples in (
            ("no_robot_said", "share of the pictures without a robot of which it is said", without),
            ("no_robot_wrongly", "share of the pictures with a robot of which none is said", shown),
        ):
            shares = mask_shares(t.model, labelled, samples)
            said = int((shares < t.model.no_robot_share).sum())
            low, high = wilson(said, len(samples))
            rows.append(
                Row(key, f"No robot: {words}", t.condition, 100.0 * said / len(samples), "%",
                    len(samples), low=100.0 * low, high=100.0 * high,
                    better="higher" if key == "no_robot_said" else "lower")
            )  # fmt: skip
    return rows


def _trained(tried: dict[str, list[Tried]]) -> list[Row]:
    """How much each network was trained."""
    rows = []
    paper = {"t4": 55 * 60.0, "t5": 60 * 60.0, "t6": 120.0, "t7": 600.0}
    for name, of in tried.items():
        if of:
            card, short, trained = of[0].model.card["training"], name[:2], of[0].trained
            rows += [
                Row(f"{short}_training_minutes", f"{short.upper()}: training time (T4 to T7: GTX "
                    "1080)", f"{trained}; {card['device']}", card["seconds"] / 60, "min",
                    paper=paper[short]),
                Row(f"{short}_ms_trained_on", f"{short.upper()}: one image by torch on the machine "
                    "that trained it", f"{trained}; {card['device']}, {card['precision']}",
                    float(card.get("ms_per_image", np.nan)), "ms", 21),
                Row(f"{short}_images_seen", f"{short.upper()}: images shown in training",
                    trained, float(card["images_seen"])),
            ]  # fmt: skip
    return rows


def _speed(tried: dict[str, list[Tried]]) -> list[Row]:
    """Milliseconds of one image: T5's network at the papers' size, and those that were trained."""
    rows = []
    full = Architecture("multi-objective", URS, pools=3)
    for pools, must in ((3, 130.0), (2, None)):
        a = Architecture("multi-objective", URS, pools=pools)
        wall, cpu = _full_size_ms(a) if pools == 3 or _torch() else (np.nan, np.nan)
        where = f"{full.width} x {full.height} px, papers' size, {pools} poolings"
        rows += [
            Row("t5_ms_cpu", "T5: one image, two threads, median wall time", where, wall, "ms",
                21, paper=15.0, must=must, aim=60.0 if must else None),
            Row("t5_ms_cpu_time", "T5: one image, processor time of both threads", where, cpu,
                "ms", 21),
        ]  # fmt: skip
    for name, of in tried.items():
        if of:
            a = of[0].model.architecture
            file = folder() / "runs" / name / "network.onnx"
            wall, cpu = milliseconds(str(file), a, 2)
            size = f"{a.width} x {a.height} px, {a.filters:g} of the filters"
            where = f"{size}, {of[0].trained}"
            rows += [
                Row(f"{name[:2]}_small_ms_cpu", f"{name[:2].upper()}: one image, two threads, "
                    "wall time", where, wall, "ms", 21),
                Row(f"{name[:2]}_small_ms_cpu_time", f"{name[:2].upper()}: the same, processor "
                    "time", where, cpu, "ms", 21),
            ]  # fmt: skip
    return rows


def _torch() -> bool:
    return importlib.util.find_spec("torch") is not None


def _full_size_ms(a: Architecture) -> tuple[float, float]:
    """Time of a network of the papers' size; weights do not change it, so they are random."""
    if not _torch():
        return np.nan, np.nan
    from armsight.recognition.networks.build import build_network
    from armsight.recognition.training.export import to_onnx

    return milliseconds(to_onnx(build_network(a), {}, half=a.pools == 2), a, 2)


def _notes(tried: dict[str, list[Tried]], bench: Bench) -> list[str]:
    """What was trained, on how much; what is missing."""
    notes = []
    for name, of in tried.items():
        if of:
            notes.append(f"{name[:2].upper()}, {of[0].trained}: {_how_trained(of[0].model)}")
    if bench.missing:
        names = "; ".join(dict.fromkeys(bench.missing))
        notes.append(f"Not there, so without figures: {names}. See docs/recognition.md.")
    if not _torch():
        notes.append("The papers' size was not timed: that needs torch to build it.")
    return notes


def _how_trained(model: Model) -> str:
    a, card = model.architecture, model.card
    t, data = card["training"], card["data"]
    stages = "; ".join(
        f"{s['name']} {s['updates']} of at most {s['planned']} updates of {s['batch']} ({s['why']})"
        for s in t["stages"]
    )
    samples = ", ".join(f"{n} {r}" for r, n in data["training_samples"].items())
    size = f"{a.width} x {a.height} px, {a.filters:g} of the papers' filters"
    return (
        f"{size}, {a.dense:g} of their dense units, {a.pools} poolings; {samples}; {stages}; "
        f"{t['seconds'] / 60:.0f} min on {t['threads']} thread(s) of {t['device']}"
        f"{'' if card['finished'] else '; not finished'}{_begun_with(card.get('parent') or {})}."
    )


def _begun_with(parent: dict[str, Any]) -> str:
    """What a transfer began with, from the card; only the last training before is in it."""
    try:
        return (
            f"; begun with weights of {parent['paper']}, {parent['data']['kind']}, "
            f"{parent['training']['images_seen']} images shown"
        )
    except (KeyError, TypeError):
        return ""


def _or_nothing(tried: list[Tried]) -> list[Tried] | list[None]:
    return tried or [None]


def _of(t: Tried | None) -> str:
    return t.condition if t else ""


def _n(scores: Scores | None) -> int:
    return 0 if scores is None else len(scores.add)


def _mean(scores: Scores | None, name: str, factor: float = 1.0) -> float:
    return np.nan if scores is None else factor * float(np.mean(getattr(scores, name)))


def _median(values: Floats) -> float:
    return 1e3 * float(np.median(values))


def _type(scores: Scores | None) -> float:
    return np.nan if scores is None else 100.0 * float((scores.said == scores.robot).mean())


def _type_bounds(scores: Scores | None) -> tuple[float | None, float | None]:
    if scores is None:
        return None, None
    low, high = wilson(int((scores.said == scores.robot).sum()), len(scores.robot))
    return 100.0 * low, 100.0 * high


def _bounds(t: Tried | None) -> Any:
    """Budgets hold in the training renderer's unseen scenes; the rest is reported without."""

    def bounds(must: float, aim: float | None) -> dict[str, float | None]:
        if t is not None and t.where != UNSEEN:
            return {}
        return {"must": must, "aim": aim}

    return bounds


def overlays(t: Tried) -> Figure:
    """Twelve test frames, spread from the best to the worst: truth white, answer red."""
    from matplotlib.figure import Figure

    order = np.argsort(t.scores.add)
    picked = order[np.linspace(0, len(order) - 1, min(12, len(order))).round().astype(int)]
    figure = Figure(figsize=(12.0, 8.2))
    axes = figure.subplots(3, 4).ravel()
    for axis in axes:
        axis.axis("off")
    for axis, k in zip(axes, picked, strict=False):
        sample = int(t.scores.samples[k])
        image = t.data.images[sample]
        answer = t.model.run(image)
        axis.imshow(image)
        axis.contour(answer.mask >= 0.5, [0.5], colors="orange", linewidths=0.8)
        count = int((~np.isnan(t.data.joints[sample, :, 0])).sum())
        truth = np.vstack([t.data.base[sample][None], t.data.joints[sample, :count]])
        said = np.vstack([answer.base[None], answer.joints[:count]])
        for points, style in ((truth, "w.-"), (said, "r.-")):
            px = points @ t.data.K[sample].T
            front = px[:, 2] > 0.05
            axis.plot(*(px[front, :2] / px[front, 2:]).T, style, ms=3, lw=1)
        axis.set(xlim=(-0.5, image.shape[1] - 0.5), ylim=(image.shape[0] - 0.5, -0.5))
        axis.set_title(
            f"{t.scores.robot[k]}, said {t.scores.said[k]}; {1e3 * t.scores.add[k]:.0f} mm",
            fontsize=8,
        )
    figure.suptitle(
        f"{t.model.card['paper']}, {t.condition}: from the best to the worst frame; "
        "truth white, answer red, mask orange"
    )
    return figure


def samples_plot(rows: list[Row]) -> Figure:
    """Median joint error against the number of training samples, T6's and T7's figures 5."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2))
    axis = figure.subplots()
    for name in SAMPLE_COUNTS:
        mine = [r for r in rows if r.key == f"{name}_samples_joint_median_mm"]
        counts = [int(r.condition.split()[0]) for r in mine]
        if counts:
            axis.plot(counts, [r.value for r in mine], "o-", label=name.upper())
    axis.set(xlabel="training samples of each robot", ylabel="median joint error [mm]")
    axis.set_ylim(bottom=0)
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    return figure


def distance_plot(tried: list[Tried]) -> Figure:
    """Median joint error against distance, T7's figure 5c."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2))
    axis = figure.subplots()
    for line, t in zip(("-", "--"), [t for t in tried if t.own], strict=False):
        for colour, (group, robots) in enumerate(GROUPS.items()):
            s = t.scores.of(np.isin(t.scores.robot, robots))
            bins = [b for b in against(s.add, s.distance, EDGES) if len(b[2]) >= LEAST]
            if bins:
                at = [0.5 * (low + high) for low, high, _ in bins]
                label = f"{group}, {t.condition}"
                axis.plot(at, [_median(v) for _, _, v in bins], f"o{line}C{colour}", label=label)
    axis.set(xlabel="distance of the base [m]", ylabel="median joint error [mm]")
    axis.set_ylim(bottom=0)
    # Beside it: there is no empty corner for so many lines.
    axis.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    axis.grid(alpha=0.3)
    return figure


EXPERIMENT = Experiment(
    "recognition",
    "The robot in one colour image: the papers' four networks (T4 to T7)",
    run,
    runs=400,
    about=(
        "The networks of T4 to T7 on rendered pictures: frames of recordings that they know, as in "
        "the papers; scenes that they do not know; and pictures of a second renderer with other "
        "rooms, lights and materials. "
        "`--runs` is the number of test frames of each robot at most. Sets and trained networks "
        "are read from `results/recognition` (see [recognition](../recognition.md))."
    ),
)

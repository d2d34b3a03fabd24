"""T4 to T7: the robot in one colour image, the papers' four networks beside their tables."""

from __future__ import annotations

import importlib.util
from functools import partial
from typing import Any

import numpy as np

from armsight.experiments.frame import Draw, Experiment, Outcome, Progress
from armsight.experiments.recognition_papers import (
    forgetting_rows,
    t4_rows,
    t4_separate_rows,
    t5_rows,
    t6_rows,
    t7_rows,
)
from armsight.experiments.recognition_plots import distance_plot, overlays, samples_plot
from armsight.experiments.recognition_rows import (
    EDGES,
    GROUNDS,
    GROUPS,
    LEAST,
    PAPERS,
    SAMPLE_COUNTS,
    URS,
    median_mm,
    size,
    under,
)
from armsight.experiments.recognition_scores import (
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
    rows += (
        t4_rows(t4)
        + t4_separate_rows(t4)
        + t5_rows(t5)
        + t6_rows(t6)
        + t7_rows(t7)
        + forgetting_rows(t7, t5)
    )
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


def _common(name: str, t: Tried, seed: int) -> list[Row]:
    """Figures that every network has, on every set."""
    s, where = t.scores, under(t)
    rng = np.random.default_rng([seed, 43])
    low, high = bootstrap((1e3 * s.add).tolist(), rng, "mean")
    base = _spread_of_frames(t)
    return [
        Row(f"{name}_add_auc", f"{name.upper()}: area under the ADD curve to 100 mm", where,
            add_auc(s.add), "", size(s), better="higher"),
        Row(f"{name}_iou", f"{name.upper()}: mask, intersection over union", where,
            float(s.iou.mean()), "", size(s), better="higher"),
        Row(f"{name}_iou_all_robot", f"{name.upper()}: IoU of a mask that is robot all over, "
            "for comparison", where, _full_mask_iou(t), "", size(s)),
        Row(f"{name}_joint_mm", f"{name.upper()}: mean joint error, with its 95 % interval", where,
            1e3 * float(np.mean(s.add)), "mm", size(s), low=low, high=high),
        Row(f"{name}_joint_mm_median", f"{name.upper()}: median joint error", where,
            median_mm(s.add), "mm", size(s)),
        Row(f"{name}_joint_mm_guess", f"{name.upper()}: mean joint error of always answering the "
            "mean of these frames' own joints, for comparison", where, base, "mm", size(s)),
        Row(f"{name}_over_100_mm", f"{name.upper()}: share of the frames off by more than 100 mm",
            where, 100.0 * share_over(s.add), "%", size(s)),
        Row(f"{name}_recognised", f"{name.upper()}: share with the right type and within 100 mm",
            where, 100.0 * recognised(s.add, s.said, s.robot), "%", size(s), better="higher"),
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
                            median_mm(values), "mm", len(values))
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
                where = f"{count} samples of each robot{fewer}; {under(t)}"
                rows += [
                    Row(f"{name}_samples_joint_median_mm", f"{name.upper()}: median joint error "
                        "against the number of samples", where, median_mm(t.scores.add), "mm",
                        size(t.scores)),
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
                    round(median_mm(np.array(errors)), 3), "mm", len(asked))
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

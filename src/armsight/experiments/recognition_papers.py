"""The papers' own figures, T4 to T7, row by row beside ours."""

from __future__ import annotations

import numpy as np

from armsight.experiments.recognition_rows import (
    GROUPS,
    URS,
    bounds_of,
    mean,
    median_mm,
    or_nothing,
    size,
    type_bounds,
    type_right,
    under,
)
from armsight.experiments.recognition_scores import UNSEEN, Tried
from armsight.experiments.rows import Row


def t4_rows(tried: list[Tried]) -> list[Row]:
    """T4's figures."""
    rows = []
    for t in or_nothing(tried):
        s = t.scores if t else None
        bounds = bounds_of(t)
        rows += [
            Row("t4_mask_accuracy", "T4, UR5: share of the pixels that are right",
                under(t), mean(s, "accuracy", 100), "%", size(s), paper=98.1, better="higher",
                **bounds(95.0, 98.1)),
            Row("t4_joint_mean_mm", "T4, UR5: mean joint error of the full system",
                under(t), mean(s, "add", 1e3), "mm", size(s), paper=24.2, **bounds(40.0, 24.2)),
        ]  # fmt: skip
    return rows


def t4_separate_rows(tried: list[Tried]) -> list[Row]:
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


def t5_rows(tried: list[Tried]) -> list[Row]:
    """T5's figures."""
    rows = []
    for t in or_nothing(tried):
        s = t.scores if t else None
        bounds = bounds_of(t)
        low, high = type_bounds(s)
        rows += [
            Row("t5_mask_accuracy", "T5, three URs: share of the pixels that are right",
                under(t), mean(s, "accuracy", 100), "%", size(s), paper=98.0, better="higher",
                **bounds(95.0, 98.0)),
            Row("t5_mask_iou", "T5: intersection over union of the mask, mean over frames",
                under(t), mean(s, "iou"), "", size(s), better="higher", **bounds(0.75, None)),
            Row("t5_type_accuracy", "T5: share of the frames with the right type", under(t),
                type_right(s), "%", size(s), low=low, high=high, paper=98.3, better="higher",
                **bounds(95.0, 98.3)),
            Row("t5_joint_mean_mm", "T5: mean joint error", under(t), mean(s, "add", 1e3), "mm",
                size(s), paper=31.6, **bounds(45.0, 31.6)),
            Row("t5_base_mean_mm", "T5: mean base error", under(t), mean(s, "base", 1e3), "mm",
                size(s), paper=27.4, **bounds(40.0, 27.4)),
        ]  # fmt: skip
        if s is None or t is None:
            continue
        rows += [
            Row("t5_base_median_mm", "T5: median base error", under(t), median_mm(s.base), "mm",
                size(s), paper=21.3),
            *(Row("t5_joint_error_mm", "T5, figure 4b: mean error of one joint",
                  f"{under(t)}; joint {k + 1}", 1e3 * float(np.mean(s.joints[:, k])), "mm", size(s))
              for k in range(6)),
            *(Row("t5_robot_joint_mean_mm", "T5: mean joint error of one robot",
                  f"{under(t)}; {r}", mean(s.of(s.robot == r), "add", 1e3), "mm",
                  int((s.robot == r).sum()))
              for r in URS if (s.robot == r).any()),
        ]  # fmt: skip
    return rows


def t6_rows(tried: list[Tried]) -> list[Row]:
    """T6's figures."""
    rows = []
    minutes, where = np.nan, ""
    for t in or_nothing(tried):
        s = t.scores if t else None
        bounds = bounds_of(t)
        error = Row("t6_joint_median_mm", "T6, iiwa: median joint error", under(t),
                    median_mm(s.add) if s else np.nan, "mm", size(s), paper=28.7,
                    **bounds(45.0, 28.7))  # fmt: skip
        rows.append(error)
        if t is None or s is None:
            continue
        rows += [
            Row("t6_base_median_mm", "T6, iiwa: median base error", under(t), median_mm(s.base),
                "mm", size(s), paper=20.2),
            Row("t6_mask_accuracy", "T6, iiwa: share of the pixels that are right", under(t),
                mean(s, "accuracy", 100), "%", size(s), paper=97.3, better="higher"),
        ]  # fmt: skip
        if error.met:
            card = t.model.card["training"]
            minutes = card["seconds"] / 60
            where = f"{under(t)}; {card['device']}, {card['threads']} thread(s)"
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


def t7_rows(tried: list[Tried]) -> list[Row]:
    """T7's figures."""
    rows = []
    for t in or_nothing(tried):
        bounds = bounds_of(t)
        types: list[float] = []
        for group, robots in GROUPS.items():
            s = t.scores.of(np.isin(t.scores.robot, robots)) if t else None
            s = s if s is not None and len(s.add) else None
            where = f"{under(t)}; {group}" if t else group
            paper = _T7_PAPER[group]
            low, high = type_bounds(s)
            types += [type_right(s)] if s else []
            rows += [
                Row("t7_mask_accuracy", "T7: share of the pixels that are right", where,
                    mean(s, "accuracy", 100), "%", size(s), paper=paper[0], better="higher"),
                Row("t7_type_accuracy", "T7: share of the frames with the right type", where,
                    type_right(s), "%", size(s), low=low, high=high, paper=paper[1],
                    better="higher"),
                Row("t7_joint_median_mm", "T7: median joint error", where,
                    median_mm(s.add) if s else np.nan, "mm", size(s), paper=paper[2],
                    **bounds(T7_JOINT_MUST, paper[2])),
                Row("t7_base_median_mm", "T7: median base error", where,
                    median_mm(s.base) if s else np.nan, "mm", size(s), paper=paper[3]),
            ]  # fmt: skip
        # A network that always says the same is right about one of them.
        rows.append(
            Row("t7_type_accuracy", "T7: share of the frames with the right type",
                f"{under(t)}; the worst of the three", min(types, default=np.nan), "%",
                size(t.scores if t else None), paper=96.1, better="higher", **bounds(92.0, 96.1))
        )  # fmt: skip
    return rows


def forgetting_rows(tried: list[Tried], t5: list[Tried]) -> list[Row]:
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
                median_mm(s.add) <= T7_JOINT_MUST
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

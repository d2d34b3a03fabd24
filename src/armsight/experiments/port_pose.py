"""The pose of a port by a converging pair: the joint fit beside the paper's plane."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from armsight.arrays import Pose
from armsight.charging.find import INLETS, SMALLEST, FindOptions, find_ports
from armsight.charging.plane_fit import contact_pixels, paper_pose
from armsight.charging.ports.table import PORTS
from armsight.charging.pose import PortPose, locate
from armsight.devices.camera_models import stereo_pair
from armsight.experiments.cache import RunCache
from armsight.experiments.ccs1_pictures import (
    PAIR,
    T_SOCKET_PORT,
    foreign_pairs,
    offset_free_errors,
)
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.port_cases import far_views, near_views, pose_error
from armsight.experiments.port_pictures import Album
from armsight.experiments.port_scene import PortView
from armsight.experiments.rows import Row, wilson
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.stereo import StereoPair

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SURE_SCORE = 0.7
"""A fit with a lower score says itself that it is spoilt, and counts as not found."""

FAR = 100
"""Situations at 1 m, at most: rare wrong rolls are counted near."""
BASELINES = (
    ("paper", "the paper's way, equations 1 to 3"),
    ("ablation_plane", "its plane through contacts that are triangulated exactly"),
)
ABOUT = """
Inlets (four types, four makes each) by the paper's converging pair (f 1200 px, 0.2 m apart), in the
lights and weathers of `port-detection`, pictures of 0.2 m about the port. The finder looks in both
pictures, the joint fit starts from what it says. Not found, or taken for another type: `missed`. A
fit that scores below 0.7 calls itself spoilt, one whose next roll or mirrored tilt is nearly as
likely doubtful: their share has its own row, and errors are those of the others.
`paper_*` rows: the contacts of the same pictures triangulated by equation 1 of the paper, and the
plane of equations 2 and 3; `ablation_plane_*`: the same plane with exact triangulation. The CCS1
pictures are other people's renderings, found and fitted without any start; `others_false`: pictures
that others took or drew to match shapes in, by a lens as long as they are wide.
"""


def measure(album: Album, pair: StereoPair, view: PortView) -> dict[str, Any]:
    """Fit one situation and score it."""
    picture = album.picture(view, both=True, window=0.11 if view.distance > 0.7 else 0.10)
    T = picture.T_camera_port[0]
    cut = replace(pair, left=picture.lenses[0], right=picture.lenses[1])
    images = (picture.images[0], picture.images[1])
    ports = locate(images, cut, FindOptions(ports=INLETS))
    if not ports:
        return {"port": view.port, "light": view.light, "found": False}
    found = ports[0]
    error = pose_error(T, found.T_ref_port, found.covariance)
    result: dict[str, Any] = {
        "found": found.port == view.port,
        "port": view.port,
        "light": view.light,
        "score": found.score,
        "gap": found.roll_gap,
        "doubtful": found.doubtful,
        "lateral": error.lateral,
        "depth": error.depth,
        "tilt": error.tilt,
        "roll": error.roll,
        "inside": error.inside,
    }
    for prefix, exact in (("paper", False), ("ablation_plane", True)):
        plane = _plane(found, picture.lenses, pair, exact)
        if plane is not None:
            error = pose_error(T, plane)
            result |= {f"{prefix}_tilt": error.tilt, f"{prefix}_lateral": error.lateral}
            result |= {f"{prefix}_depth": error.depth, f"{prefix}_roll": error.roll}
    return result


def _plane(
    found: PortPose, lenses: Sequence[PinholeCamera], pair: StereoPair, exact: bool
) -> Pose | None:
    """The paper's pose from the same edges, its pixels those of the pair's whole pictures."""
    names = tuple(pin.name for pin in PORTS[found.port].pins)
    pixels = []
    for i, (lens, whole) in enumerate(zip(lenses, (pair.left, pair.right))):
        if i >= len(found.fit.edges):
            return None
        own = found.fit.corners[i]
        shift = np.array([whole.cx - lens.cx, whole.cy - lens.cy]) + own
        pixels.append(contact_pixels(found.fit, i, names) + shift)
    return paper_pose(found.port, pixels[0], pixels[1], pair, exact)


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` near situations, half as many at 1 m (at most ``FAR``), maybe the CCS1 pictures."""
    pair = stereo_pair()
    album = Album(pair)
    cache = RunCache("port-pose", seed)
    near, far = near_views(runs, seed), far_views(min(max(runs // 2, 1), FAR), seed)
    results = []
    for i, view in enumerate([*near, *far]):
        progress("poses", i / (len(near) + len(far)))
        key = i if i < len(near) else 10**6 + i - len(near)
        results.append(cache.get(key, partial(measure, album, pair, view)))
    album.close()
    rows = _rows(results[: len(near)], results[len(near) :])
    notes = []
    for name, what, score in (
        ("ARMSIGHT_CCS1", "The CCS1 pictures of others", _foreign),
        ("ARMSIGHT_PORTLESS", "Pictures without a port that others took", _portless),
    ):
        folder = os.environ.get(name)
        if folder:
            rows += score(Path(folder))
        else:
            notes.append(f"{what} were not at hand (`{name}=FOLDER`).")
    return Outcome(tuple(rows), {"errors": lambda: _plot(results[: len(near)])}, tuple(notes))


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")


def _rows(near: list[dict[str, Any]], far: list[dict[str, Any]]) -> list[Row]:
    missed, shown = sum(not r["found"] for r in near), len(near)
    seen = [r for r in near if "score" in r]
    near, far = [r for r in near if r["found"]], [r for r in far if r["found"]]
    good = [r for r in near if r["score"] >= SURE_SCORE and not r["doubtful"]]
    flips = sum(bool(r["roll"] > np.deg2rad(20)) for r in good)
    upright = [r for r in good if r["roll"] <= np.deg2rad(20)]
    low, high = wilson(missed, shown)
    rows = [
        Row(
            "missed",
            "share of ports that the finder missed, or took for another type",
            "0.3 to 0.5 m",
            missed / max(shown, 1),
            n=shown,
            low=low,
            high=high,
        )
    ]
    for key, unit, factor, paper, must, aim in (
        ("lateral", "mm", 1e3, None, 0.4, 0.15),
        ("depth", "mm", 1e3, None, 0.8, 0.3),
        ("tilt", "deg", 180 / np.pi, 2.0, 0.6, 0.25),
        ("roll", "deg", 180 / np.pi, None, 0.5, 0.2),
    ):
        name = f"{key}_{unit}"
        values = [r[key] for r in upright]
        worst = float(np.percentile(values, 95)) if values else float("nan")
        rows.append(
            Row(
                name,
                f"error of the joint fit, rms; upper spread: 95th percentile ({key})",
                "0.3 to 0.5 m",
                factor * _rms(values),
                unit,
                len(values),
                0.0,
                factor * worst,
                paper,
                must,
                aim,
            )
        )
        for prefix, how in BASELINES:
            plane = [r[f"{prefix}_{key}"] for r in upright if f"{prefix}_{key}" in r]
            rows.append(
                Row(
                    f"{prefix}_{name}",
                    f"{how} ({key})",
                    "0.3 to 0.5 m",
                    factor * _rms(plane),
                    unit,
                    len(plane),
                )
            )
    sure = [r for r in far if r["score"] >= SURE_SCORE]
    degrees = 180 / np.pi
    rows.append(
        Row(
            "far_tilt_deg",
            "error of the joint fit, rms",
            "1 m, 20-30 deg off axis",
            degrees * _rms([r["tilt"] for r in sure if r["roll"] < 0.35]),
            "deg",
            len(sure),
            paper=2.0,
            must=1.0,
            aim=0.5,
        )
    )
    for prefix, how in BASELINES:
        values = [r[f"{prefix}_tilt"] for r in sure if f"{prefix}_tilt" in r]
        rows.append(
            Row(
                f"{prefix}_far_tilt_deg",
                how,
                "1 m, 20-30 deg off axis",
                degrees * _rms(values),
                "deg",
                len(values),
            )
        )
    low, high = wilson(flips, len(good))
    per = 1e3 / max(len(good), 1)
    rows.append(
        Row(
            "roll_flips",
            "wrong rolls that were not called doubtful, in 1000",
            "0.3 to 0.5 m",
            per * flips,
            n=len(good),
            low=1e3 * low,
            high=1e3 * high,
            paper=200,
            must=3,
            aim=0,
        )
    )
    inside = sum(r["inside"] for r in upright)
    low, high = wilson(inside, len(upright))
    share = inside / max(len(upright), 1)
    rows.append(
        Row(
            "coverage_95",
            "truth in the stated 95 % ellipsoid",
            "0.3 to 0.5 m, at least",
            share,
            n=len(upright),
            low=low,
            high=high,
            must=0.88,
            aim=0.93,
            better="higher",
        )
    )
    rows.append(
        Row(
            "coverage_95",
            "truth in the stated 95 % ellipsoid",
            "0.3 to 0.5 m, at most",
            share,
            n=len(upright),
            low=low,
            high=high,
            must=0.99,
            aim=0.97,
        )
    )
    spoilt = len(near) - len(good)
    low, high = wilson(spoilt, len(near))
    rows.append(
        Row(
            "spoilt",
            "share of fits that call themselves spoilt or doubtful",
            "0.3 to 0.5 m",
            spoilt / max(len(near), 1),
            n=len(near),
            low=low,
            high=high,
        )
    )
    above = [r for r in seen if r["score"] > 0.95]
    wrong = sum(
        bool(not r["found"] or r["lateral"] > 1e-3 or r["tilt"] > np.deg2rad(1.0)) for r in above
    )
    low, high = wilson(wrong, len(above))
    rows.append(
        Row(
            "wrong_above_095",
            "share of scores over 0.95 that are off by 1 mm or 1 deg",
            "0.3 to 0.5 m, pair",
            wrong / len(above) if above else float("nan"),
            n=len(above),
            low=low,
            high=high,
            must=0.02,
            aim=0.005,
            why="no such score",
        )
    )
    return rows


def _foreign(folder: Path) -> list[Row]:
    """Rows of the CCS1 pictures that others rendered."""
    found, truth, hits, false = [], [], 0, 0
    for item in foreign_pairs(folder):
        poses = [p for p in locate(item.images, PAIR, FindOptions(ports=INLETS)) if p.score >= 0.75]
        if item.T_left_socket is None:
            false += len(poses)
        elif poses and poses[0].port == "ccs1":
            hits += 1
            found.append(poses[0].T_ref_port)
            truth.append(item.T_left_socket @ T_SOCKET_PORT)
    where = "pictures of others"
    shift, turn = offset_free_errors(np.array(found), np.array(truth)) if found else ([], [])
    mm = 1e3 * float(np.median(shift)) if shift else float("nan")
    degrees = float(np.rad2deg(np.median(turn))) if turn else float("nan")
    n = len(found)
    return [
        Row(
            "ccs1_found",
            "CCS1 inlets found, with their type",
            where,
            hits,
            n=4,
            must=4,
            aim=4,
            better="higher",
        ),
        Row("ccs1_false", "ports found where there is none", where, false, n=1, must=0, aim=0),
        Row(
            "ccs1_mm",
            "median error of the place after one offset",
            where,
            mm,
            "mm",
            n,
            must=3,
            aim=1.5,
        ),
        Row(
            "ccs1_deg",
            "median error of the attitude after one offset",
            where,
            degrees,
            "deg",
            n,
            must=1,
            aim=0.6,
        ),
    ]


def _portless(folder: Path) -> list[Row]:
    """Ports found in a folder's pictures, of which none shows one."""
    looked_at = found = 0
    for file in sorted(f for f in folder.rglob("*") if f.suffix in (".png", ".jpg", ".bmp")):
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        if image is None or min(image.shape) < SMALLEST:
            continue
        (h, w), f = image.shape, float(max(image.shape))
        lens = PinholeCamera(w, h, f, f, 0.5 * (w - 1), 0.5 * (h - 1))
        looked_at += 1
        found += len(find_ports(np.asarray(image), lens))
    what = "ports found in pictures of circles, crosses and boards without one, one picture each"
    return [Row("others_false", what, "pictures of others", found, n=looked_at, must=0, aim=0)]


def _plot(near: list[dict[str, Any]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 3.5))
    for i, (key, unit, factor) in enumerate((("lateral", "mm", 1e3), ("tilt", "deg", 180 / np.pi))):
        axes = figure.add_subplot(1, 2, i + 1)
        for name, label in ((key, "joint fit"), (f"paper_{key}", "the paper's plane")):
            values = np.sort([factor * r[name] for r in near if name in r])
            axes.plot(values, np.linspace(0, 1, len(values)), label=label)
        axes.set_xscale("log")
        axes.set_xlabel(f"{key} [{unit}]")
        axes.set_ylabel("share of pictures below")
        axes.legend()
    figure.tight_layout()
    return figure


EXPERIMENT = Experiment(
    "port-pose", "The pose of a port by a converging pair", run, runs=100, about=ABOUT
)

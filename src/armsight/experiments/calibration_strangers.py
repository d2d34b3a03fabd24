"""Calibration on other people's data: layouts, false accusations, mistakes, honesty, peers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.calibration.synthetic_set import ArmErrors, make_set
from armsight.experiments.cache import RunCache
from armsight.experiments.calibration_corner_scenes import DETECTORS, SCENES, scene_run
from armsight.experiments.calibration_layouts import LAYOUTS
from armsight.experiments.calibration_mistakes import MISTAKES
from armsight.experiments.calibration_real import DATA
from armsight.experiments.calibration_stranger_runs import (
    ARMS,
    clean_run,
    layout_run,
    mistake_run,
    shipped_run,
)
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, wilson
from armsight.robots import load_robot
from armsight.robots.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHIPPED = {
    "rwhe_synthetic_2": "checkerboard:9x6:200",
    "rwhe_kuka_1": "checkerboard:28x17:20",
    "ros_industrial_charuco": "",
    "visp_eye_to_hand": "tag:48:10",
}
"""Sets as their authors ship them, and all that is said about them."""
FULL = 800
SHARES = {"mistakes": 40, "corners": 40}
"""Sets with each mistake, and pictures of each scene, for so many clean sets."""
CHI2 = 12.592
"""95 % of chi squared with six degrees of freedom."""

Run = dict[str, Any]


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """All parts; ``runs`` is the number of clean sets, the others in proportion."""
    robot = load_robot("ur5")
    count = {kind: max(1, round(n * runs / FULL)) for kind, n in SHARES.items()}
    shipped, words = _shipped(seed, progress)
    layouts, unread = _layouts(seed, robot, progress)
    corners = _corners(count["corners"], seed, progress)
    clean = _clean(runs, seed, robot, progress)
    mistakes, told = _mistakes(count["mistakes"], seed, robot, progress)
    rows = [*_clean_rows(clean), *mistakes, *shipped, *layouts, *corners]
    plots = {
        "honesty": lambda: _draw_honesty(clean),
        "mistakes": lambda: _draw_mistakes(mistakes),
    }
    return Outcome(tuple(rows), plots, tuple(words + unread + told))


def _shipped(seed: int, progress: Progress) -> tuple[list[Row], list[str]]:
    """Sets as they are shipped, solved by nothing but the board; peers on the same corners."""
    cache = RunCache("calibration-strangers-shipped", seed)
    found: dict[str, Run] = {}
    for k, (name, words) in enumerate(SHIPPED.items()):
        progress(f"shipped sets: {name}", 0.1 * k / len(SHIPPED))
        if (DATA / name).is_dir():
            found[name] = cache.get(k, lambda n=name, w=words: shipped_run(n, w, seed))  # type: ignore[misc]
    if not found:
        return [], ["The recorded sets are not beside this checkout: nothing is said of them."]
    loaded = sum(bool(f["loaded"]) for f in found.values())
    solved = sum(bool(f["solved"]) for f in found.values())
    rows = [
        _share("sets_loaded", "recorded sets that load as shipped", "as shipped", loaded,
               len(found), 0.95, 1.0, "higher"),
        _share("sets_solved", "recorded sets solved without force", "as shipped", solved,
               len(found), 0.95, 1.0, "higher"),
    ]  # fmt: skip
    synthetic = found.get("rwhe_synthetic_2", {})
    if "error_mm" in synthetic:
        rows.append(
            Row("stranger_mm", "distance of the camera on the arm from the truth",
                "rwhe_synthetic_2 (joint solve of its authors' corners: 0.156)",
                synthetic["error_mm"], "mm", 19, must=0.20, aim=0.15)
        )  # fmt: skip
    for name, f in found.items():
        if f.get("ratio") is None:
            continue
        must, aim = (0.75, 0.65) if name == "rwhe_kuka_1" else (None, None)
        what = "left-out error over that of OpenCV's best solver"
        rows.append(
            Row("stranger_ratio", what, name, f["ratio"], "1", f["views"], must=must, aim=aim)
        )
        for peer, mm in f["peers"].items():
            what = "mean distance on the board's plane, views left out one at a time"
            rows.append(Row("left_out_mm", what, f"{name}, {peer}", mm, "mm", f["views"]))
    return rows, [f"{name}: {f['told']}" for name, f in found.items() if f["told"]]


def _layouts(seed: int, robot: Robot, progress: Progress) -> tuple[list[Row], list[str]]:
    """Every layout written from one set, read back: the poses must come out as they went in."""
    cache = RunCache("calibration-strangers-layouts", seed)
    rng = np.random.default_rng([seed, 1])
    failed: list[str] = []
    for at, mount in enumerate(("base", "flange")):
        one = make_set(robot, rng, 16, mount, ArmErrors(2e-4, 5e-4))  # type: ignore[arg-type]
        for k, name in enumerate(LAYOUTS):
            progress(f"layouts: {name}", 0.1 + 0.02 * at)
            number = at * len(LAYOUTS) + k
            if not cache.get(number, lambda n=name, one=one: bool(layout_run(n, one))):  # type: ignore[misc]
                failed.append(f"{name}, {mount}")
    total = 2 * len(LAYOUTS)
    row = _share(
        "sets_loaded", "sets written in all layouts that are read as what they are",
        f"{len(LAYOUTS)} layouts, two mounts", total - len(failed), total, 0.95, 1.0, "higher",
    )  # fmt: skip
    return [row], [f"Not read rightly: {', '.join(failed)}."] if failed else []


def _corners(each: int, seed: int, progress: Progress) -> list[Row]:
    """Corner errors on rendered boards, scene by scene and together."""
    cache = {s: RunCache("calibration-strangers-corners", seed, s) for s in SCENES}
    runs: dict[str, list[Run]] = {}
    for at, scene in enumerate(SCENES):
        progress(f"corners: {scene}", 0.15 + 0.1 * at / len(SCENES))
        runs[scene] = [
            cache[scene].get(k, lambda k=k, s=scene: scene_run(seed, s, k))  # type: ignore[misc]
            for k in range(each)
        ]
    rows = []
    for detector in DETECTORS:
        ours = detector == "armsight"
        errors: dict[str, list[float]] = {}
        for scene, mine in runs.items():
            seen = [r[detector] for r in mine if r[detector] is not None]
            errors[scene] = [e for s in seen for e in s if e is not None]
        together = [e for mine in errors.values() for e in mine]
        for scene, found in (("all scenes", together), *errors.items()):
            must = (0.05, 0.5) if ours else (None, None)
            aim = (0.03, 0.2) if ours else (None, None)
            for k, (what, q) in enumerate((("median", 0.5), ("99 % quantile", 0.99))):
                value = float(np.quantile(found, q)) if found else float("nan")
                whole = scene == "all scenes"
                rows.append(
                    Row(f"corner_px_{'median' if k == 0 else 'p99'}", f"corner error, {what}",
                        f"{scene}, {detector}", value, "px", len(found),
                        must=must[k] if whole else None, aim=aim[k] if whole else None)
                )  # fmt: skip
        total = each * len(SCENES)
        missed = sum(r[detector] is None for mine in runs.values() for r in mine)
        rows.append(_share("boards_missed", "boards not found", detector, missed, total))
    return rows


def _clean(count: int, seed: int, robot: Robot, progress: Progress) -> list[Run]:
    """Clean sets of arms of all qualities, through files and the whole way."""
    cache = RunCache("calibration-strangers-clean", seed)
    runs = []
    for k in range(count):
        progress(f"clean sets: {k}", 0.25 + 0.35 * k / count)
        runs.append(cache.get(k, lambda k=k: clean_run(seed, k, robot)))  # type: ignore[misc]
    return runs


def conditions(run: Run) -> list[str]:
    """Every row of the table of coverage that a clean set counts in."""
    views = run["views"]
    return [
        "lens given, its centre off by 2 px" if run["lens"] else "lens free",
        "8 to 14 views" if views < 15 else "15 to 27 views" if views < 28 else "28 to 40 views",
        f"arms with {run['arm']}",
        "camera beside the arm" if run["mount"] == "base" else "camera on the arm",
    ]


def _clean_rows(runs: Sequence[Run]) -> list[Row]:
    """Nobody may be accused; the model must not overreach; the ellipsoid must hold the truth."""
    what = "arms of 0.1 to 3 mm, 8 to 40 views"
    blamed = sum(any(t[1] == "error" for t in r["told"]) for r in runs)
    ratios = [r["ratio"] for r in runs if r["ratio"] is not None]
    rows = [
        _share("false_accusations", "clean sets that get an error finding", what, blamed,
               len(runs), 0.01, 0.002),
        _share("overfreed", "sets whose chosen model's true error is over 1.3 times the best's",
               what, sum(r > 1.3 for r in ratios), max(len(ratios), 1), 0.05, 0.01),
    ]  # fmt: skip
    names = dict.fromkeys(c for r in runs for c in conditions(r))
    held = "true camera poses within the stated 95 % ellipsoid"
    for name in ("all", *sorted(names)):
        mine = [r for r in runs if name == "all" or name in conditions(r)]
        inside = sum(r["chi2"] is not None and r["chi2"] < CHI2 for r in mine)
        n = len(mine)
        rows.append(_share("coverage_95", held, name, inside, n, 0.88, 0.93, "higher"))
        rows.append(
            _share("coverage_95_above", f"{held}: no more than", name, inside, n, 0.99, 0.97)
        )
    codes = Counter(code for r in runs for code in {t[0] for t in r["told"]})
    rows += [
        _share("false_alarm", "clean sets that get this finding, of any weight", code, n, len(runs))
        for code, n in sorted(codes.items())
    ]
    return rows


def _mistakes(
    each: int, seed: int, robot: Robot, progress: Progress
) -> tuple[list[Row], list[str]]:
    """Every mistake in some clean sets."""
    rows: list[Row] = []
    right = wrong = total = 0
    called: Counter[str] = Counter()
    for number, name in enumerate(MISTAKES):
        progress(f"mistakes: {name}", 0.6 + 0.4 * number / len(MISTAKES))
        cache = RunCache("calibration-strangers-mistakes", seed, name)
        runs = [
            cache.get(k, lambda k=k, n=name: mistake_run(seed, n, k, robot))  # type: ignore[misc]
            for k in range(each)
        ]
        named = sum(bool(r["named"]) for r in runs)
        astray = sum(bool(r["wrong"]) for r in runs)
        called.update(f"{code} for {name}" for r in runs for code in r["wrong"])
        right, wrong, total = right + named, wrong + astray, total + each
        rows.append(_share("mistake_named", "sets whose mistake was named", name, named, each))
    head = [
        _share("mistakes_named", "mistakes named rightly", f"{len(MISTAKES)} kinds", right, total,
               0.95, 0.99, "higher"),
        _share("wrong_names", "sets with a mistake that got a wrong name, too",
               f"{len(MISTAKES)} kinds", wrong, total, 0.01, 0.0),
    ]  # fmt: skip
    words = ", ".join(f"{c} {n}" for c, n in called.most_common())
    return [*head, *rows], [f"Wrong names: {words}."] if words else []


def _share(
    key: str,
    measure: str,
    condition: str,
    hits: int,
    n: int,
    must: float | None = None,
    aim: float | None = None,
    better: str = "lower",
) -> Row:
    low, high = wilson(hits, n)
    return Row(
        key, measure, condition, hits / n, "", n, low, high, must=must, aim=aim,
        better="higher" if better == "higher" else "lower",
    )  # fmt: skip


def _draw_honesty(runs: Sequence[Run]) -> Figure:
    """True errors against stated ones, and the coverage of each condition."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.6))
    left, right = figure.subplots(1, 2)
    for arm in ARMS:
        mine = [r for r in runs if r["arm"] == arm and r["error"] is not None]
        left.loglog(
            [1e3 * r["sigma"] for r in mine], [1e3 * r["error"] for r in mine], ".", label=arm
        )
    ends = np.array(left.get_xlim())
    left.plot(ends, ends, "k-", lw=0.8)
    left.set(xlabel="stated sigma of the camera's place [mm]", ylabel="true error [mm]")
    left.legend(fontsize=8)
    rows = [r for r in _clean_rows(runs) if r.key == "coverage_95"][::-1]
    place = np.arange(len(rows))
    value = np.array([r.value for r in rows])
    low, high = (np.array([getattr(r, k) for r in rows]) for k in ("low", "high"))
    right.axvspan(0.88, 0.99, color="tab:green", alpha=0.15, label="must")
    right.axvline(0.95, color="k", lw=0.8)
    right.errorbar(value, place, xerr=[value - low, high - value], fmt="o", capsize=3)
    right.set_yticks(place, [f"{r.condition} ({r.n})" for r in rows], fontsize=8)
    right.set(xlabel="truth within the stated 95 % ellipsoid", xlim=(min(0.6, low.min()), 1.0))
    right.legend(fontsize=8, loc="lower left")
    figure.tight_layout()
    return figure


def _draw_mistakes(rows: Sequence[Row]) -> Figure:
    """Share of the sets in which each mistake got its name."""
    from matplotlib.figure import Figure

    mine = [r for r in rows if r.key == "mistake_named"][::-1]
    figure = Figure(figsize=(7, 8))
    axes = figure.subplots()
    place = np.arange(len(mine))
    axes.barh(place, [r.value for r in mine], color="tab:blue", alpha=0.8)
    axes.set_yticks(place, [r.condition for r in mine], fontsize=8)
    axes.axvline(0.95, color="k", lw=0.8)
    axes.set(xlabel=f"named rightly ({mine[0].n} sets each; line: must)", xlim=(0, 1))
    figure.tight_layout()
    return figure


EXPERIMENT = Experiment(
    "calibration-strangers",
    "Calibration on other people's data",
    run,
    FULL,
    about=(
        "Recorded sets of others as they are shipped; one set in every layout that people keep "
        "poses in; clean sets of arms that err by 0.1 to 3 mm (independently, by wrong zeros, "
        "lengths and sag, by backlash), through files and the whole way: who is accused, and how "
        "often the stated ellipsoid of the camera's pose (six numbers) holds the truth; mistakes "
        "put into clean sets; corners of rendered boards beside OpenCV's detectors. Thresholds are "
        "the same for all. `--runs` is the number of clean sets; of each mistake, and of each "
        "scene of corners, there are 40 for 800."
    ),
)

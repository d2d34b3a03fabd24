"""Calibration on other people's data: layouts, false accusations, mistakes, honesty, peers."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armsight.calibration import se3
from armsight.calibration.boards import Board, parse_board
from armsight.calibration.calibrate import Calibration
from armsight.calibration.export import opencv_yaml
from armsight.calibration.peers import compare
from armsight.calibration.problem import Mount
from armsight.calibration.recorded_set import RecordedSet, load
from armsight.calibration.recorded_solve import solve_set
from armsight.calibration.synthetic_set import LENS, ArmErrors, SyntheticSet, make_set
from armsight.errors import ArmsightError
from armsight.experiments.cache import RunCache
from armsight.experiments.calibration_layouts import LAYOUTS, PlainSet, write_corners, write_layout
from armsight.experiments.calibration_mistakes import (
    BOARD,
    MISTAKES,
    clean_set,
    findings_of,
    judge,
    write_mistake,
)
from armsight.experiments.calibration_real import DATA
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, wilson
from armsight.robots import load_robot
from armsight.robots.robot import Robot

SHIPPED = {
    "rwhe_synthetic_2": "checkerboard:9x6:200",
    "rwhe_kuka_1": "checkerboard:28x17:20",
    "ros_industrial_charuco": "",
    "visp_eye_to_hand": "tag:48:10",
}
"""Sets as their authors ship them, and all that is said about them."""
SHARES = {"clean": 500, "mistakes": 40, "coverage": 100}
"""Sets of each kind at the full number of runs."""
FULL = 500
STATE = 3
"""Of the calibration's code: runs that an older one has kept do not count."""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """All parts; ``runs`` is the number of clean sets, the others in proportion."""
    robot = load_robot("ur5")
    share = runs / FULL

    def count(kind: str) -> int:
        return max(1, round(SHARES[kind] * share))

    rows: list[Row] = []
    notes: list[str] = []
    parts: tuple[tuple[str, float, Callable[[], tuple[list[Row], list[str]]]], ...] = (
        ("layouts", 0.1, lambda: _layouts(seed, robot)),
        ("mistakes", 0.2, lambda: _mistakes(count("mistakes"), seed, robot, progress)),
        ("clean sets", 0.5, lambda: _clean(count("clean"), seed, robot, progress)),
        ("coverage", 0.8, lambda: _coverage(count("coverage"), seed, robot, progress)),
        ("shipped sets", 0.95, lambda: _shipped(seed, progress)),
    )
    for part, done, work in parts:
        progress(part, done)
        more, words = work()
        rows += more
        notes += words
    return Outcome(tuple(rows), {}, tuple(notes))


def _shipped(seed: int, progress: Progress) -> tuple[list[Row], list[str]]:
    """Sets as they are shipped, solved by nothing but the board; peers on the same corners."""
    cache = RunCache("calibration-strangers-shipped", seed, {"sets": SHIPPED, "state": STATE})
    found: dict[str, dict[str, Any]] = {}
    for k, (name, words) in enumerate(SHIPPED.items()):
        progress(f"shipped sets: {name}", 0.95 + 0.05 * k / len(SHIPPED))
        if not (DATA / name).is_dir():
            continue
        found[name] = cache.get(k, lambda n=name, w=words: _one_shipped(n, w, seed))  # type: ignore[misc]
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
        if f.get("ratio") is not None:
            kuka = name == "rwhe_kuka_1"
            rows.append(
                Row("stranger_ratio", "left-out error over that of OpenCV's best solver", name,
                    f["ratio"], "1", f["views"], must=0.75 if kuka else None,
                    aim=0.65 if kuka else None)
            )  # fmt: skip
            for peer, mm in f["peers"].items():
                what = "mean distance on the board's plane, views left out one at a time"
                rows.append(Row("left_out_mm", what, f"{name}, {peer}", mm, "mm", f["views"]))
    return rows, [f"{name}: {f['told']}" for name, f in found.items() if f["told"]]


def _one_shipped(name: str, words: str, seed: int) -> dict[str, Any]:
    board: Board | None = parse_board(words) if words else None
    out: dict[str, Any] = {"loaded": False, "solved": False, "told": "", "views": 0}
    try:
        recorded = load(DATA / name, board)
        out["loaded"] = recorded.poses is not None
        answer = solve_set(recorded, seed=seed)
    except ArmsightError as error:
        return out | {"told": str(error)}
    out["told"] = "; ".join(f"{f.severity} {f.code}" for f in answer.findings)
    done = answer.calibration
    if done is None or any(f.severity == "error" for f in answer.findings):
        return out
    out |= {"solved": True, "views": len(done.problem.used_views)}
    if name == "rwhe_synthetic_2":  # GroundTruth.txt: the camera stands in the flange
        out["error_mm"] = 1e3 * float(np.linalg.norm(done.camera_pose(0)[:3, 3]))
    if len(done.problem.used_views) >= 8:
        peers = compare(done)
        out["peers"] = {p.name: p.mm for p in peers}
        others = [p.mm for p in peers if p.name != "armsight"]
        out["ratio"] = out["peers"]["armsight"] / min(others)
    return out


def _layouts(seed: int, robot: Robot) -> tuple[list[Row], list[str]]:
    """Every layout written from one set, read back: the poses must come out as they went in."""
    rng = np.random.default_rng([seed, 1])
    failed: list[str] = []
    total = 0
    for mount in ("base", "flange"):
        one = make_set(robot, rng, 16, mount, ArmErrors(2e-4, 5e-4))
        every = np.arange(len(one.points))
        plain = PlainSet(one.told, tuple((every, p) for p in one.pixels), _size(one))
        for name in LAYOUTS:
            total += 1
            with tempfile.TemporaryDirectory() as place:
                write_layout(Path(place), name, plain)
                if not _right(Path(place), one):
                    failed.append(f"{name}, {mount}")
    good = total - len(failed)
    row = _share(
        "sets_loaded", "sets written in all layouts that are read as what they are",
        f"{len(LAYOUTS)} layouts, two mounts", good, total, 0.95, 1.0, "higher",
    )  # fmt: skip
    return [row], [f"Not read rightly: {', '.join(failed)}."] if failed else []


def _right(place: Path, one: SyntheticSet) -> bool:
    try:
        found = load(place, BOARD)
    except ArmsightError:
        return False
    if found.poses is None or found.cameras[0].mount != one.mount:
        return False
    return np.allclose(found.poses[found.cameras[0].view], one.told, atol=1e-4)


def _mistakes(
    each: int, seed: int, robot: Robot, progress: Progress
) -> tuple[list[Row], list[str]]:
    """Every mistake in some clean sets."""
    rows: list[Row] = []
    right = wrong = total = 0
    called: Counter[str] = Counter()
    for number, name in enumerate(MISTAKES):
        progress(f"mistakes: {name}", 0.2 + 0.3 * number / len(MISTAKES))
        cache = RunCache("calibration-strangers-mistakes", seed, {"mistake": name, "state": STATE})

        def one(k: int, name: str = name, number: int = number) -> dict[str, Any]:
            rng = np.random.default_rng([seed, 2, number, k])
            with tempfile.TemporaryDirectory() as place:
                folder = write_mistake(Path(place), name, clean_set(robot, rng), rng)
                named, others = judge(name, findings_of(Path(place), folder))
            return {"named": named, "wrong": sorted(others)}

        runs = [cache.get(k, lambda k=k: one(k)) for k in range(each)]  # type: ignore[misc]
        named = sum(bool(r["named"]) for r in runs)
        astray = sum(bool(r["wrong"]) for r in runs)
        called.update(code for r in runs for code in r["wrong"])
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


def _arm(rng: np.random.Generator) -> ArmErrors:
    """An arm of any quality: 0.1 to 3 mm, of one kind of error or of several."""
    size = float(np.exp(rng.uniform(np.log(1e-4), np.log(3e-3))))
    kinds = (
        ArmErrors(size, 0.0, 0.0),
        ArmErrors(1e-4, size, 0.0),
        ArmErrors(1e-4, 0.0, size),
        ArmErrors(1e-4, 0.7 * size, 0.7 * size),
    )
    return kinds[int(rng.integers(len(kinds)))]


def _size(one: SyntheticSet) -> tuple[int, int]:
    return one.camera.width, one.camera.height


def _solved(
    one: SyntheticSet, lens: bool, rng: np.random.Generator
) -> tuple[RecordedSet, Calibration | None, list[tuple[str, str]]]:
    """A set through the whole way, from files to findings; a given lens is off by 2 px."""
    camera = one.camera
    off = replace(
        camera, cx=camera.cx + float(rng.choice([-2, 2])), cy=camera.cy + float(rng.choice([-2, 2]))
    )
    every = np.arange(len(one.points))
    plain = PlainSet(one.told, tuple((every, p) for p in one.pixels), _size(one))
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        write_corners(place, plain)
        (place / "poses.txt").write_text(
            "\n".join(" ".join(f"{v:.9f}" for v in T.ravel()) for T in one.told) + "\n"
        )
        if lens:
            (place / "lens.yaml").write_text(opencv_yaml(off))
        recorded = load(place, BOARD)
        answer = solve_set(recorded)
    return recorded, answer.calibration, [(f.code, f.severity) for f in answer.findings]


def _clean(count: int, seed: int, robot: Robot, progress: Progress) -> tuple[list[Row], list[str]]:
    """Clean sets of arms of all qualities: nobody may be accused; the model must not overreach."""
    cache = RunCache("calibration-strangers-clean", seed, {"arms": "all", "state": STATE})

    def one(k: int) -> dict[str, Any]:
        rng = np.random.default_rng([seed, 3, k])
        mount: Mount = "base" if rng.random() < 0.5 else "flange"
        drawn = make_set(robot, rng, int(rng.integers(8, 41)), mount, _arm(rng))
        try:
            _, done, told = _solved(drawn, bool(k % 2), rng)
        except ArmsightError as error:
            return {"told": [["refused", "error", str(error)]], "ratio": None}
        out: dict[str, Any] = {"told": told, "ratio": None}
        if done is not None and done.selection is not None:
            errors = [
                drawn.target_error(_lens(t.solution.state.lens[0]), t.solution.state.T_mount_rig[0])
                for t in done.selection.trials
            ]
            mine = drawn.target_error(done.lens(0), done.camera_pose(0))
            out["ratio"] = mine / min(errors)
        return out

    runs = []
    for k in range(count):
        progress(f"clean sets: {k}", 0.5 + 0.3 * k / count)
        runs.append(cache.get(k, lambda k=k: one(k)))  # type: ignore[misc]
    blamed = sum(any(t[1] == "error" for t in r["told"]) for r in runs)
    ratios = [r["ratio"] for r in runs if r["ratio"] is not None]
    rows = [
        _share("false_accusations", "clean sets that get an error finding",
               "arms of 0.1 to 3 mm, 8 to 40 views", blamed, count, 0.01, 0.002),
        _share("overfreed", "sets whose chosen model's true error is over 1.3 times the best's",
               "arms of 0.1 to 3 mm, 8 to 40 views", sum(r > 1.3 for r in ratios),
               max(len(ratios), 1), 0.05, 0.01),
    ]  # fmt: skip
    codes = Counter(code for r in runs for code in {t[0] for t in r["told"]})
    rows += [
        _share("false_alarm", "clean sets that get this finding, of any weight", code, n, count)
        for code, n in sorted(codes.items())
    ]
    return rows, []


def _lens(values: Any) -> Any:
    from armsight.calibration.problem import lens_from_vector

    return lens_from_vector(np.asarray(values), LENS.width, LENS.height)


CONDITIONS: dict[str, tuple[bool, int | None, Callable[[np.random.Generator], ArmErrors]]] = {
    "lens given, its centre off by 2 px": (True, None, _arm),
    "lens free": (False, None, _arm),
    "8 views": (True, 8, _arm),
    "40 views": (True, 40, _arm),
    "arms with wrong lengths, 1 mm": (True, None, lambda rng: ArmErrors(1e-4, 1e-3, 0.0)),
    "arms with backlash, 1 mm": (True, None, lambda rng: ArmErrors(1e-4, 0.0, 1e-3)),
}
"""Whether a lens is given, how many views, and how the arm errs."""


def _coverage(
    count: int, seed: int, robot: Robot, progress: Progress
) -> tuple[list[Row], list[str]]:
    """How often the 95 % ellipsoid of the camera's pose (six numbers) holds the truth."""
    rows = []
    for number, (name, (lens, views, arm)) in enumerate(CONDITIONS.items()):
        progress(f"coverage: {name}", 0.8 + 0.15 * number / len(CONDITIONS))
        cache = RunCache(
            "calibration-strangers-coverage", seed, {"condition": name, "state": STATE}
        )

        def one(
            k: int,
            number: int = number,
            lens: bool = lens,
            views: int | None = views,
            arm: Callable[[np.random.Generator], ArmErrors] = arm,
        ) -> float:
            rng = np.random.default_rng([seed, 4, number, k])
            mount: Mount = "base" if rng.random() < 0.5 else "flange"
            n = views or int(rng.integers(8, 41))
            drawn = make_set(robot, rng, n, mount, arm(rng))
            try:
                done = _solved(drawn, lens, rng)[1]
            except ArmsightError:
                return 1e9
            if done is None:
                return 1e9
            d = se3.logs(se3.inverses(done.camera_pose(0)[None]) @ drawn.T_mount_camera)[0]
            return float(d @ np.linalg.solve(done.covariance.camera_pose(0), d))

        chi2 = np.array([cache.get(k, lambda k=k: one(k)) for k in range(count)])  # type: ignore[misc]
        inside = int(np.sum(chi2 < 12.592))
        what = "true camera poses within the stated 95 % ellipsoid"
        rows.append(_share("coverage_95", what, name, inside, count, 0.88, 0.93, "higher"))
        above = _share(
            "coverage_95_above", f"{what}: no more than", name, inside, count, 0.99, 0.97
        )
        rows.append(above)
    return rows, []


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


EXPERIMENT = Experiment(
    "calibration-strangers",
    "Calibration on other people's data",
    run,
    FULL,
    about=(
        "Recorded sets of others as they are shipped; one set in every layout that people keep "
        "poses in; clean sets of arms that err by 0.1 to 3 mm (independently, by wrong zeros, "
        "lengths and sag, by backlash), through files and the whole way; mistakes put into clean "
        "sets; how often the stated ellipsoid holds the truth. Thresholds are the same for all. "
        "`--runs` is the number of clean sets; of each mistake there are 40 for 500, of each "
        "condition of coverage 100."
    ),
)

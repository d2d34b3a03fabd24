"""The mistakes that users of hand-eye tools report, found by name (design page, 5.8).

Each mistake leaves a sign. Angles between views survive an inversion, a wrong unit or a wrong board
size; they do not survive a wrong rotation format or a wrong pairing. So every other reading of the
poses is tried, and one that fits several times better names the mistake.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Poses
from armsight.calibration import se3
from armsight.calibration.closed_form import shah
from armsight.calibration.findings import Finding
from armsight.calibration.lens import zhang
from armsight.calibration.model import Model
from armsight.calibration.problem import Freedom, Problem, Sighting, lens_from_vector, lens_vector
from armsight.calibration.solver import Solution, SolverOptions, solve
from armsight.calibration.start import HandEyeStart, PlanarPose, arm_for, hand_eye_start
from armsight.calibration.start import planar_poses as planar
from armsight.geometry.camera import PinholeCamera

BETTER = 3.0
"""Another reading must fit this many times better to be named."""

SLIP_RATIO = 12.0
"""F ratio above which a board counts as slipped: clean sets stay below 3, 2 mm give 30."""

Item = tuple[int, PlanarPose, Sighting]


@dataclass(frozen=True)
class RawPoses:
    """Poses as they stood in the file, so that other readings can be tried.

    Attributes:
        position: (n, 3) as written.
        rotation: (n, 4) quaternions, (n, 3) vectors or angles, or (n, 9) matrices, as written.
        kind: ``quaternion`` (x y z w), ``vector`` (axis times angle), ``rpy`` or ``matrix``.
    """

    position: Floats
    rotation: Floats
    kind: str

    def poses(self) -> Poses:
        """(n, 4, 4) read as documented: metres, radians, x y z w."""
        return _poses(self.position, _rotations(self.kind, self.rotation))


def _rotations(kind: str, r: Floats) -> Floats:
    if kind == "quaternion":
        return Rotation.from_quat(r).as_matrix()
    if kind == "vector":
        return Rotation.from_rotvec(r).as_matrix()
    if kind == "rpy":
        return Rotation.from_euler("xyz", r).as_matrix()
    if kind == "matrix":
        return r.reshape(-1, 3, 3)
    raise ValueError(f"unknown rotation kind {kind!r}")


def _poses(position: Floats, R: Floats) -> Poses:
    T = np.zeros((len(position), 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = R, position, 1.0
    return T


def other_rotations(raw: RawPoses) -> list[tuple[str, str, str, Poses]]:
    """Other readings of the rotations: (code, what it would mean, what to do, poses)."""
    r, out = raw.rotation, []

    def add(code: str, words: str, cure: str, R: Floats) -> None:
        out.append((code, words, cure, _poses(raw.position, R)))

    if raw.kind == "quaternion":
        add(
            "quaternion_order",
            "the quaternions are w x y z, not x y z w",
            "reorder the columns, or name them qw qx qy qz",
            _rotations("quaternion", r[:, [1, 2, 3, 0]]),
        )
    if raw.kind in ("vector", "rpy"):
        other = "rpy" if raw.kind == "vector" else "vector"
        name = {"rpy": "roll, pitch, yaw", "vector": "rotation vectors"}
        add(
            "degrees",
            "the angles are in degrees, not radians",
            "write radians, or name the columns with _deg",
            _rotations(raw.kind, np.deg2rad(r)),
        )
        add(
            "rotation_format",
            f"the angles are {name[other]}, not {name[raw.kind]}",
            "name the columns by what they are",
            _rotations(other, r),
        )
        add(
            "rotation_format",
            f"the angles are {name[other]} in degrees, not {name[raw.kind]}",
            "name the columns by what they are",
            _rotations(other, np.deg2rad(r)),
        )
        add(
            "rotation_format",
            "the angles are turned about the moving z, y, x axes in that order",
            "write quaternions instead",
            Rotation.from_euler("ZYX", r).as_matrix(),
        )
    if raw.kind == "matrix":
        add(
            "matrix_order",
            "the rotation matrices are written column by column",
            "write them row by row",
            np.swapaxes(r.reshape(-1, 3, 3), 1, 2),
        )
    return out


@dataclass(frozen=True)
class Fit:
    """How well a reading fits: the start it gives, its median error, how angles agree."""

    start: HandEyeStart
    median_px: float
    angle_gap: float


def fit_reading(A: Poses, items: list[Item], problem: Problem, seed: int) -> Fit | None:
    """Fit camera and board to arm poses as read."""
    if len(items) < 3 or not np.isfinite(A).all():
        return None
    s = items[0][2]
    lens, points = problem.lenses[s.lens], problem.boards[s.board].points
    start = hand_eye_start(A, items, points, lens.camera, np.random.default_rng(seed))
    if start is None:
        return None
    views = [v for v, _, _ in items]
    C = se3.inverses(start.X[None]) @ A[views] @ start.Z
    errors = []
    for k, (_, _, s) in enumerate(items):
        p = points[s.corner] @ C[k, :3, :3].T + C[k, :3, 3]
        d = lens.camera.project(p) - s.pixel
        errors.append(np.sqrt(np.mean(np.sum(d * d, axis=1))) if np.isfinite(d).all() else 1e6)
    return Fit(start, float(np.median(errors)), angle_gap(A[views], items))


def angle_gap(A: Poses, items: list[Item]) -> float:
    """Median difference of the angles by which arm and board turn between views [rad]."""
    i, j = np.triu_indices(len(A), 1)
    a = np.linalg.norm(se3.logs(se3.inverses(A[i]) @ A[j])[:, 3:], axis=1)
    gaps = []
    for x in (0, -1):
        C = np.array([p.T_lens_board[x] for _, p, _ in items])
        c = np.linalg.norm(se3.logs(se3.inverses(C[i]) @ C[j])[:, 3:], axis=1)
        gaps.append(np.abs(a - c))
    return float(np.median(np.minimum(*gaps)))


def items_of(problem: Problem, rig: int) -> list[Item]:
    """Board poses in a rig's most used lens, arm views only."""
    count: dict[int, int] = {}
    for s in problem.sightings:
        if problem.lenses[s.lens].rig == rig and not problem.views[s.view].free:
            count[s.lens] = count.get(s.lens, 0) + 1
    if not count:
        return []
    lens = max(count, key=lambda k: count[k])
    out: list[Item] = []
    for s in problem.sightings:
        if s.lens == lens and not problem.views[s.view].free:
            p = planar(
                problem.lenses[lens].camera, problem.boards[s.board].points[s.corner], s.pixel
            )
            if p is not None:
                out.append((s.view, p, s))
    return out


def diagnose_start(
    problem: Problem, rig: int, raw: RawPoses | None = None, seed: int = 0
) -> list[Finding]:
    """Mistakes in how poses and images were written down.

    Args:
        problem: with sightings and arm poses as read.
        rig: the camera.
        raw: the poses as they stood in the file, to try other formats.
        seed: of the random samples.
    """
    name = problem.rigs[rig].name
    items = items_of(problem, rig)
    findings = view_findings(problem, rig, items) + resolution_findings(problem, rig)
    if len(items) < 3 or any(f.code == "lens_resolution" for f in findings):
        return findings
    A = arm_for(problem, rig)
    asis = fit_reading(A, items, problem, seed)
    if asis is None:
        return findings
    focal = problem.lenses[items[0][2].lens].camera.fx
    if asis.median_px < max(2.0, 0.004 * focal):
        return findings + some_flipped(problem, items, asis, A)
    trials: list[tuple[Fit, Finding]] = []

    def consider(poses: Poses, pairs: list[Item], finding: Finding) -> None:
        fit = fit_reading(poses, pairs, problem, seed)
        if fit is not None:
            trials.append((fit, finding))

    hand = problem.rigs[rig].mount == "flange"
    place = "on the flange" if hand else "beside the robot"
    other = "beside the robot" if hand else "on the flange"
    consider(
        se3.inverses(A),
        items,
        Finding(
            "pose_inverted",
            "error",
            f"the poses fit only when inverted: they map base to flange, or camera {name} stands "
            f"{other} and not {place}",
            "write T_base_flange (the flange in the base), and say where the camera is mounted",
        ),
    )
    if raw is not None:
        for code, words, cure, poses in other_rotations(raw):
            P = poses if not hand else se3.inverses(poses)
            consider(P, items, Finding(code, "error", f"{words}: so read, the data fit", cure))
            consider(
                se3.inverses(P),
                items,
                Finding(
                    code,
                    "error",
                    f"{words}, and the poses are inverted: so read, the data fit",
                    cure,
                ),
            )
    for finding, permuted in _orders(items):
        consider(A, permuted, finding)
    scale = unit_scale(A, items)
    if scale is not None:
        scaled = A.copy()
        scaled[:, :3, 3] *= scale
        consider(scaled, items, _scale_finding(scale, problem, items))
    flipped = _flipped(problem, items, asis, A)
    if flipped is not None:
        consider(A, flipped[1], flipped[0])
    if trials:
        fit, finding = min(trials, key=lambda t: t[0].median_px)
        if fit.median_px * BETTER < asis.median_px and fit.median_px < 0.02 * focal:
            detail = f" ({asis.median_px:.0f} px as read, {fit.median_px:.1f} px so)"
            return [*findings, replace(finding, message=finding.message + detail)]
    if asis.median_px > 0.03 * focal:
        words = (
            f"arm and board turn by different angles between the views (by "
            f"{np.rad2deg(asis.angle_gap):.1f} deg)"
            if asis.angle_gap > np.deg2rad(2)
            else "angles agree but positions do not"
        )
        findings.append(
            Finding(
                "poses_do_not_match",
                "error",
                f"camera {name}: poses and images do not belong together: {words}, "
                f"{asis.median_px:.0f} px",
                "check that each image was taken at its pose, with the arm at rest",
            )
        )
    return findings


def _orders(items: list[Item]) -> list[tuple[Finding, list[Item]]]:
    """Other pairings of images and poses."""
    out = []
    views = sorted(v for v, _, _ in items)
    last = max(views)

    def pair(code: str, words: str, cure: str, to: Callable[[int], int]) -> None:
        moved = [(to(v), p, s) for v, p, s in items]
        moved = [(v, p, s) for v, p, s in moved if 0 <= v <= last]
        if len(moved) >= 4:
            out.append((Finding(code, "error", words, cure), moved))

    cure = "pair each image with the pose at its exposure; number both with leading zeros"
    for shift in (1, -1, 2, -2):
        direction = "later" if shift > 0 else "earlier"
        pair(
            "shifted",
            f"images and poses are shifted: each image fits the pose {abs(shift)} {direction}",
            cure,
            partial(int.__add__, shift),
        )
    pair("order", "the poses are in the opposite order of the images", cure, lambda v: last - v)
    by_name = sorted(range(last + 1), key=str)  # 0, 1, 10, 11, 2 ...
    back = list(np.argsort(by_name))
    pair(
        "order",
        "images are sorted as text (1, 10, 11, 2), poses as numbers",
        cure,
        lambda v: by_name[v],
    )
    pair(
        "order",
        "poses are sorted as text (1, 10, 11, 2), images as numbers",
        cure,
        lambda v: int(back[v]),
    )
    one = sorted(range(1, last + 2), key=str)
    pair(
        "order",
        "images are sorted as text (1, 10, 11, 2), poses as numbers",
        cure,
        lambda v: one[v] - 1,
    )
    back_one = list(np.argsort(one))
    pair(
        "order",
        "poses are sorted as text (1, 10, 11, 2), images as numbers",
        cure,
        lambda v: int(back_one[v]),
    )
    return out


def unit_scale(A: Poses, items: list[Item]) -> float | None:
    """Factor on the arm's positions that makes them fit the board's size; None without one."""
    views = [v for v, _, _ in items]
    C = np.array([p.T_lens_board[0] for _, p, _ in items])
    A = A[views]
    X, _ = shah(A, C)
    n = len(A)
    for _ in range(2):
        rows = np.zeros((3 * n, 7))
        rows[:, :3] = A[:, :3, :3].reshape(3 * n, 3)
        rows[:, 3:6] = np.tile(-np.eye(3), (n, 1))
        rows[:, 6] = A[:, :3, 3].reshape(3 * n)
        right = (C[:, :3, 3] @ X[:3, :3].T).reshape(3 * n)
        column = np.maximum(np.linalg.norm(rows, axis=0), 1e-12)
        t = np.linalg.lstsq(rows / column, right, rcond=None)[0] / column
        miss = np.linalg.norm((rows @ t - right).reshape(n, 3), axis=1)
        keep = miss <= 2.5 * np.median(miss)
        if keep.all() or keep.sum() < 4:
            break
        A, C, n = A[keep], C[keep], int(keep.sum())
        X, _Z = shah(A, C)
    scale = float(t[6])
    return scale if 1e-5 < scale < 1e5 else None


def _scale_finding(scale: float, problem: Problem, items: list[Item]) -> Finding:
    for factor, words, cure in (
        (1e-3, "the positions are in millimetres, not metres", "write metres"),
        (1e3, "the board's size is in millimetres, not metres", "give the board's size in metres"),
        (1e-2, "the positions are in centimetres, not metres", "write metres"),
        (0.0254, "the positions are in inches, not metres", "write metres"),
    ):
        if abs(np.log(scale / factor)) < 0.12:
            return Finding("millimetres", "error", f"{words}: so read, the data fit", cure)
    board = problem.boards[items[0][2].board]
    p = board.points
    square = float(np.min(np.linalg.norm(p[1:] - p[0], axis=1)))
    return Finding(
        "board_size",
        "error",
        f"angles agree but lengths do not: the board {board.name} would fit with corners "
        f"{1e3 * square / scale:.2f} mm apart, not {1e3 * square:.2f} mm",
        "measure the printed board over its whole length and give that size",
    )


def _flipped(
    problem: Problem, items: list[Item], fit: Fit, A: Poses
) -> tuple[Finding, list[Item]] | None:
    """Items with boards turned by 180 degrees where that fits better."""
    lens = problem.lenses[items[0][2].lens].camera
    points = problem.boards[items[0][2].board].points
    if len(points) < 4:
        return None
    turned = []
    for v, _, s in items:
        whole = len(s.corner) == len(points)
        if not whole:
            return None
        other = replace(s, pixel=s.pixel[::-1])
        p = planar(lens, points[other.corner], other.pixel)
        if p is None:
            return None
        turned.append((v, p, other))
    # Which of each pair of readings agree in angle with the arm: grow from the first view.
    best: tuple[float, list[Item]] | None = None
    for seed in range(min(3, len(items))):
        chosen = list(items)
        for k in range(len(items)):
            costs = []
            for candidate in (items[k], turned[k]):
                a = A[[items[seed][0], items[k][0]]]
                costs.append(angle_gap(a, [items[seed], candidate]))
            if k != seed and costs[1] + np.deg2rad(3) < costs[0]:
                chosen[k] = turned[k]
        gap = angle_gap(A[[v for v, _, _ in chosen]], chosen)
        if best is None or gap < best[0]:
            best = (gap, chosen)
    assert best is not None
    count = sum(a is not b for a, b in zip(best[1], items))
    count = min(count, len(items) - count)
    if not count:
        return None
    return _flip_finding(count, len(items)), best[1]


def some_flipped(problem: Problem, items: list[Item], fit: Fit, A: Poses) -> list[Finding]:
    """Boards read turned by 180 degrees among others that are read rightly."""
    lens = problem.lenses[items[0][2].lens].camera
    points = problem.boards[items[0][2].board].points
    C = se3.inverses(fit.start.X[None]) @ A @ fit.start.Z
    count = 0
    for v, _, s in items:
        if len(s.corner) != len(points):
            continue
        p = lens.project(points[s.corner] @ C[v, :3, :3].T + C[v, :3, 3])
        right = np.median(np.linalg.norm(p - s.pixel, axis=1))
        turned = np.median(np.linalg.norm(p - s.pixel[::-1], axis=1))
        count += bool(turned * BETTER < right and turned < max(6.0, 4 * fit.median_px))
    if not count:
        return []
    return [_flip_finding(count, len(items))]


def _flip_finding(count: int, total: int) -> Finding:
    return Finding(
        "flipped",
        "error",
        f"the board is read turned by 180 deg in {count} of {total} images",
        "use a board whose corners cannot be confused: a hollow corner square, ChArUco or tags",
    )


def view_findings(problem: Problem, rig: int, items: list[Item]) -> list[Finding]:
    """Too few views, or views too much alike, to tell the unknowns apart."""
    name = problem.rigs[rig].name
    out = []
    if len(items) < 3:
        return [
            Finding(
                "few_views",
                "error",
                f"camera {name} saw the board in {len(items)} views; three are the least, fifteen "
                "are good",
                "take more views, and turn the board about all three axes",
            )
        ]
    A = arm_for(problem, rig)[[v for v, _, _ in items]]
    i, j = np.triu_indices(len(A), 1)
    turns = se3.logs(se3.inverses(A[i]) @ A[j])[:, 3:]
    angle = np.linalg.norm(turns, axis=1)
    largest = float(np.rad2deg(angle.max()))
    if largest < 10:
        return [
            Finding(
                "alike",
                "error",
                f"camera {name}: the arm turns by at most {largest:.1f} deg between the views",
                "turn the board by 30 deg or more about different axes between views",
            )
        ]
    # Turns about one axis leave the direction along it unknown.
    spread = np.linalg.svd(turns[angle > np.deg2rad(5)], compute_uv=False)
    second = float(spread[1] / spread[0])
    if second < 0.08:
        out.append(
            Finding(
                "one_axis",
                "error",
                f"camera {name}: all turns are about one axis; the position along it is unknown",
                "turn the board about a second axis by 30 deg or more in some views",
            )
        )
    elif largest < 25 or len(items) < 6:
        out.append(
            Finding(
                "few_views",
                "warning",
                f"camera {name}: {len(items)} views with at most {largest:.0f} deg of turn",
                "take fifteen views with turns of 30 deg or more about all axes",
            )
        )
    return out


def diagnose_solution(solution: Solution, rig: int) -> list[Finding]:
    """Mistakes that show only in the residuals of a good solve."""
    lens = _distortion(solution, rig)
    # A lens that is wrong leaves residuals that a second board would explain in part.
    return [*lens, *([] if lens else _slip(solution, rig)), *_moving(solution, rig)]


def resolution_findings(problem: Problem, rig: int) -> list[Finding]:
    """A lens that was given for images of another size, told by the board alone."""
    out = []
    for index, lens in enumerate(problem.lenses):
        mine = [s for s in problem.sightings if s.lens == index]
        if lens.rig != rig or len(mine) < 4:
            continue
        points = [problem.boards[s.board].points[s.corner] for s in mine]
        pixels = [s.pixel for s in mine]
        outside = max(float(p.max(0)[0]) for p in pixels) / lens.camera.width
        found = zhang(points, pixels, lens.camera.width, lens.camera.height)
        if outside > 1.02:  # the middle is wrong then: take that of an image that holds all
            grow = 2 ** np.ceil(np.log2(outside))
            found = zhang(
                points, pixels, int(lens.camera.width * grow), int(lens.camera.height * grow)
            )
        if found is None:
            continue
        ratio = found.fx / lens.camera.fx
        for factor in (0.25, 1 / 3, 0.5, 2 / 3, 1.5, 2.0, 3.0, 4.0):
            if abs(np.log(ratio / factor)) < 0.12:
                out.append(
                    Finding(
                        "lens_resolution",
                        "error",
                        f"lens {lens.name} belongs to another resolution: the images want a focal "
                        f"length {ratio:.2f} times that given",
                        f"scale the lens by {factor:.3g}, or give that of this image size",
                    )
                )
    return out


def _distortion(solution: Solution, rig: int) -> list[Finding]:
    """A kept distortion that the data contradict."""
    model = solution.model
    problem = model.problem
    out: list[Finding] = []
    if model.freedom.lens and not any(lens.keep for lens in problem.lenses):
        return out
    for index, lens in enumerate(problem.lenses):
        if lens.rig != rig or index not in model.lens_of:
            continue
        lenses = tuple(
            replace(item, keep=k != index, prior=None if k == index else item.prior)
            for k, item in enumerate(problem.lenses)
        )
        # An arm that repeats: large pose errors would hide in part what the lens does.
        arm = Freedom(lens=False, shape=False, white=(1e-4, 2e-4))
        fast = SolverOptions(iterations=30, tolerance=1e-6)
        state = model.with_exact_views(solution.state)
        held = solve(Model(problem, arm), state, fast)
        trial = Model(replace(problem, lenses=lenses), replace(arm, lens=True))
        freed = solve(trial, state, fast)
        before, after = lens_vector(lens.camera), freed.state.lens[index]
        r = np.linspace(0, np.hypot(lens.camera.width, lens.camera.height) / 2 / before[0], 20)
        change = (after - before)[[4, 5, 8]] @ np.array([r**3, r**5, r**7])
        change -= r * (change @ r) / (r @ r)  # a change of focal length is no distortion
        bend = float(np.abs(change).max() * before[0])
        kept, free = _median_px(held, index), _median_px(freed, index)
        if bend > 1.0 and kept > 1.4 * free:
            out.append(
                Finding(
                    "distortion",
                    "warning",
                    f"lens {lens.name}: its distortion is missing, wrong or applied twice (up to "
                    f"{bend:.1f} px); freed, the error falls from {kept:.2f} to {free:.2f} px",
                    "calibrate the lens, or give images as they came from the camera",
                )
            )
    return out


def _median_px(solution: Solution, lens: int) -> float:
    raw = np.linalg.norm(solution.residual, axis=-1) * solution.model.sigma[:, None]
    return float(np.median(raw[(solution.model.lens_of == lens)[:, None] & solution.model.seen]))


def _slip(solution: Solution, rig: int) -> list[Finding]:
    """A board that slipped, or a camera that was bumped, at some view.

    A likelihood ratio: two boards against one, over every place in the order of views.
    """
    model = solution.model
    problem = model.problem
    mine = problem.only_lenses([i for i, lens in enumerate(problem.lenses) if lens.rig == rig])
    views = [v for v in mine.used_views if not problem.views[v].free]
    if len(views) < 8:
        return []
    freedom = Freedom(lens=False, shape=False, robot=mine.robot is not None, white=(1e-4, 2e-4))
    fast = SolverOptions(iterations=8, tolerance=1e-4)
    fixed = tuple(replace(lens, camera=_solved(solution, i)) for i, lens in enumerate(mine.lenses))
    mine = replace(mine, lenses=fixed)
    exact = replace(solution.state, E=np.tile(np.eye(4), (len(problem.views), 1, 1)))
    first = solve(Model(mine, freedom), exact, fast)
    n = len(mine.boards)
    doubled = replace(
        first.state,
        T_mount_board=np.concatenate([first.state.T_mount_board] * 2),
        shape=np.concatenate([first.state.shape] * 2),
    )
    best: tuple[float, int] | None = None
    for k in range(3, len(views) - 2):
        late = set(views[k:])
        split = replace(
            mine,
            boards=(*mine.boards, *mine.boards),
            sightings=tuple(
                replace(s, board=s.board + n) if s.view in late else s for s in mine.sightings
            ),
        )
        cost = solve(Model(split, freedom), doubled, fast).normal.cost
        if best is None or cost < best[0]:
            best = (cost, k)
    assert best is not None
    freedom_left = max(2 * int(first.model.seen.sum()) - 12 - 6 * len(views), 12)
    noise = max(2 * best[0] / freedom_left, 1.0)
    ratio = 2 * (first.normal.cost - best[0]) / 6 / noise
    if ratio < SLIP_RATIO:
        return []
    return [
        Finding(
            "slip",
            "error",
            f"board or camera {problem.rigs[rig].name} moved between view {views[best[1] - 1]} and "
            f"view {views[best[1]]}: apart, the two parts fit (F {ratio:.0f})",
            "tighten the board and the camera's stand, and repeat",
        )
    ]


def _solved(solution: Solution, lens: int) -> PinholeCamera:
    camera = solution.model.problem.lenses[lens].camera
    return lens_from_vector(solution.state.lens[lens], camera.width, camera.height)


def _moving(solution: Solution, rig: int) -> list[Finding]:
    """Residuals that grow with the arm's speed at exposure."""
    model = solution.model
    speed = np.array([np.linalg.norm(v.twist[:3]) for v in model.problem.views])
    if speed.max(initial=0.0) < 2e-3:
        return []
    mine = np.flatnonzero(model.rig_of == rig)
    raw = np.linalg.norm(solution.residual, axis=-1) * model.sigma[:, None]
    error = np.array([np.median(raw[f][model.seen[f]]) for f in mine])
    v = speed[model.view_of[mine]]
    if len(mine) < 6 or np.std(v) < 1e-6:
        return []
    correlation = float(np.corrcoef(v, error)[0, 1])
    if correlation < 0.6:
        return []
    return [
        Finding(
            "moving",
            "warning",
            f"camera {model.problem.rigs[rig].name}: errors grow with the arm's speed at exposure "
            f"(correlation {correlation:.2f})",
            "let the arm rest for 0.3 s before each image",
        )
    ]

"""One recording as T4 to T7 made them: a camera put somewhere, an arm that sweeps its joints.

"Kinect was placed at arbitrary position observing the workspace of the robot"; "each robot joint is
moved through the full range of motion in combination with other joints"; "the step size of the
joint movements is varied between the datasets" (T5, section II; T4 says the same). The counts bear
it out: 252, 756 and 1512 are products of small numbers. So a recording is a grid over the joints,
without what would touch anything, seen from one place. The Panda's camera alone was moved by hand
(T7), so that each of its pictures has a place of its own.

Within a recording room, light, furniture, tool and exposure stay; people and other arms come and
go.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Ints, JointVector, Points
from armsight.recognition.data.arms import Arm
from armsight.recognition.data.configuration import is_free
from armsight.recognition.data.framing import LEAST_GAP, View, draw_views, framed
from armsight.recognition.data.recipe import Recipe
from armsight.recognition.data.room import Room, Stand

FRAMES: dict[str, tuple[int, ...]] = {
    "ur3": (211, 252, 463),
    "ur5": (252, 756, 1512),
    "ur10": (112, 278, 514),
    "iiwa": (1,) * 14,
    "panda": (1,) * 5,
}
"""Frames of each recording (T4, table I); of iiwa and Panda only their number is known (T7)."""
CAMERA_MOVES = ("panda",)
"""Robots before which the camera was moved by hand."""
PROBES = 48
"""Configurations that a camera's place is judged by."""
IN_FRAME = 0.9
"""Share of the sweep that the frame of a standing camera holds."""
LEAST_IN_FRAME = 0.75
"""Share of the arm in the frame, in each picture ("in some cases the robot went out of bounds")."""
NEAREST_OF = 3
"""Places from which the nearest is taken: their robots fill more of the picture than ours."""
MOST_GRID = 60_000


@dataclass(frozen=True)
class Recording:
    """What the frames of a recording share.

    Attributes:
        q: (n, dof) the configurations, one a frame [rad].
        view: the camera; None where it moves.
        centers, radii: spheres of the arm over the sweep, in world [m]: (m, 3) and (m,).
    """

    q: Floats
    view: View | None
    centers: Points
    radii: Floats


@dataclass(frozen=True)
class Place:
    """Which frame a sample is.

    Attributes:
        scene: recording or room, counted within its robot.
        frame, frames: number within the recording, and of how many; 0 of 0 without recordings.
    """

    scene: int
    frame: int = 0
    frames: int = 0


def frames_of(robot: str, count: int) -> tuple[Ints, Ints, Ints]:
    """How a robot's samples are dealt to its recordings, in the papers' proportions.

    Returns:
        (count,) recording, (count,) frame within it, (recordings,) frames of each. Recordings take
        turns, so that the beginning of a set has something of each.
    """
    share = np.array(FRAMES.get(robot, (1,)), float)
    when = np.concatenate([(np.arange(count) + 0.5) / s for s in share])
    which = np.repeat(np.arange(len(share)), count)
    scene = which[np.lexsort((which, when))][:count]
    frame = np.zeros(count, np.int64)
    frames = np.zeros(len(share), np.int64)
    for k in range(len(share)):
        mine = scene == k
        frames[k] = mine.sum()
        frame[mine] = np.arange(frames[k])
    return scene, frame, frames


def sweep(
    arm: Arm, stand: Stand, view: View | None, frames: int, rng: np.random.Generator
) -> Floats:
    """(frames, dof) configurations of a grid over the joints, in the order of the sweep [rad].

    The grid is refined, joints near the base first, until enough of it touches nothing and lies in
    the picture; of that, every so-manieth is taken.
    """
    phase = rng.random(arm.n)
    # Coarser, and tables and the arm itself would leave a joint that carries others one value.
    levels = np.full(arm.n, 2)
    levels[:3] = 4, 3, 3
    turn = 0
    while True:
        if levels.prod() >= frames:
            q = _grid(arm, levels, phase)
            usable = q[[_usable(arm, one, stand, view) for one in q]]
            if len(usable) >= frames or len(q) > MOST_GRID:
                break
        # Seven steps of the first joint, as 7 divides the papers' 112, 252, 756 and 1512.
        joint = 0 if levels[0] < 7 else 1 + turn % (arm.n - 1)
        turn += levels[0] >= 7
        levels[joint] += 1
    if len(usable) == 0:
        return np.empty((0, arm.n))
    return np.asarray(usable[np.linspace(0, len(usable) - 1, frames).astype(int)])


def _grid(arm: Arm, levels: Ints, phase: Floats) -> Floats:
    """Every combination of evenly spaced values; the last joint moves fastest."""
    axes = [
        arm.lower[j] + (np.arange(n) + phase[j]) / n * (arm.upper[j] - arm.lower[j])
        for j, n in enumerate(levels)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, arm.n)


def _usable(arm: Arm, q: JointVector, stand: Stand, view: View | None) -> bool:
    poses = stand.T_world_base @ arm.link_poses(q)
    if not is_free(arm, poses, stand.blocked):
        return False
    if view is None:
        return True
    centers = arm.spheres(poses)
    eye = view.T_world_camera[:3, 3]
    if np.linalg.norm(centers - eye, axis=1).min() < LEAST_GAP:
        return False
    return framed(view.lens, view.T_world_camera, centers, arm.sphere_radius)[0] >= LEAST_IN_FRAME


def record(
    recipe: Recipe,
    arm: Arm,
    room: Room,
    stand: Stand,
    size: tuple[int, int],
    frames: int,
    rng: np.random.Generator,
) -> Recording | None:
    """A recording, or None if the place allows none.

    Args:
        recipe: ranges.
        arm: before the camera.
        room: where the camera may be.
        stand: what the arm stands on.
        size: width, height [px].
        frames: of it.
        rng: of the scene.
    """
    probes = sweep(arm, stand, None, PROBES, rng)
    if len(probes) == 0:
        return None
    spheres = np.concatenate([arm.spheres(stand.T_world_base @ arm.link_poses(q)) for q in probes])
    radii = np.tile(arm.sphere_radius, len(probes))
    view = None
    if arm.name not in CAMERA_MOVES:
        base = stand.T_world_base[:3, 3]
        views = draw_views(
            recipe, size, spheres, radii, base, room.corners, rng, NEAREST_OF, IN_FRAME
        )
        if not views:
            return None
        view = min(views, key=lambda v: float(np.linalg.norm(v.T_world_camera[:3, 3] - base)))
    q = sweep(arm, stand, view, frames, rng)
    return Recording(q, view, spheres, radii) if len(q) == frames else None

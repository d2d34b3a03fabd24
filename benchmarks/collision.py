"""Collision checks against brute force: nothing missed, hardly anything refused too many.

Spheres at random places, and poses of a UR5 with all its spheres and itself, against every solid
cube of the map one by one, without the distance field. ``--quick`` takes a hundredth of the 10^7
spheres and 10^6 poses.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.mapping.snapshot import OCCUPIED
from armsight.motion.collision import CollisionModel
from armsight.motion.kernels import body_centers, config_free, sphere_clearances
from armsight.robots import load_robot
from common import Report
from scenes import ball, box, snapshot_of


@njit
def brute_sphere(low, voxel, x, y, z):
    """Distance of a point to the nearest of all cubes."""
    best = np.inf
    for k in range(low.shape[0]):
        dx = max(low[k, 0] - x, x - low[k, 0] - voxel, 0.0)
        dy = max(low[k, 1] - y, y - low[k, 1] - voxel, 0.0)
        dz = max(low[k, 2] - z, z - low[k, 2] - voxel, 0.0)
        best = min(best, dx * dx + dy * dy + dz * dz)
    return np.sqrt(best)


@njit
def judge_spheres(low, voxel, centers, radius, found, bottom, top):
    """(missed, refused too many, truly free) over spheres."""
    missed = refused = free = 0
    for i in range(centers.shape[0]):
        d = brute_sphere(low, voxel, centers[i, 0], centers[i, 1], centers[i, 2])
        for a in range(3):
            d = min(d, centers[i, a] - bottom[a], top[a] - centers[i, a])
        touches = d - radius[i] < 0.0
        free += not touches
        missed += touches and found[i] >= 0.0
        refused += not touches and found[i] < 0.0
    return missed, refused, free


@njit
def judge_poses(body, ob, scratch, low, voxel, poses, pairs, bottom, top):
    """(missed, refused too many, truly free) over poses."""
    missed = refused = free = 0
    centers = scratch.centers.copy()
    for p in range(poses.shape[0]):
        said = config_free(body, ob, poses[p], scratch)
        body_centers(body, poses[p], centers)
        clear = np.inf
        for i in range(body.radius.shape[0]):
            d = brute_sphere(low, voxel, centers[i, 0], centers[i, 1], centers[i, 2])
            for a in range(3):
                d = min(d, centers[i, a] - bottom[a], top[a] - centers[i, a])
            clear = min(clear, d - body.radius[i])
            if clear < 0.0:
                break
        for k in range(pairs.shape[0]):
            a, b = pairs[k, 0], pairs[k, 1]
            d = np.sqrt(((centers[a] - centers[b]) ** 2).sum())
            clear = min(clear, d - body.pair_radius[k])
        free += clear >= 0.0
        missed += clear < 0.0 and said
        refused += clear >= 0.0 and not said
    return missed, refused, free


def main() -> None:
    """Run and print."""
    report = Report("collision", __doc__)
    share = 0.01 if report.quick else 1.0
    rng = np.random.default_rng(0)
    robot = load_robot("ur5")
    model = CollisionModel(robot)
    scene = snapshot_of([box((0.5, 0.0, 0.35), (0.05, 0.3, 0.5)), ball((-0.4, 0.4, 0.6), 0.07)])
    grid = scene.grid
    bottom, top = grid.origin, grid.origin + np.array(grid.shape) * grid.voxel
    low = grid.origin + np.argwhere(scene.state == OCCUPIED) * grid.voxel
    ob = model.obstacles(scene)

    count = int(1e7 * share)
    missed = refused = free = 0
    while count > 0:
        part = min(count, 200_000)
        count -= part
        centers, radius = rng.uniform(bottom, top, (part, 3)), rng.uniform(0.01, 0.1, part)
        out = np.empty(part)
        sphere_clearances(ob, centers, radius, out)
        m, r, f = judge_spheres(low, grid.voxel, centers, radius, out, bottom, top)
        missed, refused, free = missed + m, refused + r, free + f
    report.add("missed_spheres", missed, "", must="<= 0", note=f"of {int(1e7 * share):.0e}")
    report.add("refused_spheres", 100.0 * refused / free, "%", aim="<= 2")

    count = int(1e6 * share)
    poses = rng.uniform(-np.pi, np.pi, (count, robot.n))
    missed, refused, free = judge_poses(
        model.body, ob, model.scratch(), low, grid.voxel, poses, model.body.pairs, bottom, top
    )
    report.add("missed_collisions", missed, "", must="<= 0", note=f"of {count:.0e} UR5 poses")
    report.add("refused_poses", 100.0 * refused / free, "%", aim="<= 2")
    report.finish()


if __name__ == "__main__":
    main()

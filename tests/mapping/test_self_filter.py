"""The arm in its own pictures: fields, pixels and voxels against distances written down exactly."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.pose import from_rpy, inverse, make_pose, transform
from armsight.geometry.shapes import Solid
from armsight.mapping.kernels.body import MIDDLE, WHOLE
from armsight.mapping.kernels.pixels import ROBOT, VALID
from armsight.mapping.lens import DepthLens
from armsight.mapping.self_filter import BAND, CELL, SelfFilter, _field, body_fields
from armsight.mapping.snapshot import VoxelGrid
from armsight.robots import load_robot, load_tool
from armsight.robots.held import holding
from armsight.robots.kinematics import link_poses

from . import scenes

HELD = [
    Solid("board", "box", (0.2, 0.1, 0.04), from_rpy((0.4, -0.3, 0.8), (0.05, 0.0, 0.1))),
    Solid("can", "cylinder", (0.04, 0.15, 0.0), from_rpy((0.9, 0.2, 0.0), (0.0, 0.2, 0.0))),
    Solid("ball", "sphere", (0.05, 0.0, 0.0), make_pose(translation=(0.0, -0.2, 0.05))),
]
ROBOT_ = scenes.two_link_arm().with_tool(holding(None, HELD))
Q, RATES = np.array([0.4, -0.6]), np.array([1.0, -0.5])
WORST = 0.003
"""What a field of 1 cm loses of a sharp edge, about [m]."""


def parts(robot=ROBOT_):
    """Each part of the body in its link's frame: link, distance of points to it, its extent."""
    c = robot.capsules
    for link, a, b, r in zip(c.link, c.start, c.end, c.radius):

        def rod(points, a=a, b=b, r=r):
            s = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            return np.linalg.norm(points - a - s[:, None] * (b - a), axis=1) - r

        yield int(link), rod, np.minimum(a, b) - r, np.maximum(a, b) + r
    for solid in HELD:
        T = robot.T_last_flange @ solid.T_frame_solid
        placed = Solid(solid.name, solid.kind, solid.size, T)
        x, y, z = solid.size
        half = {"box": (x / 2, y / 2, z / 2), "cylinder": (x, x, y / 2), "sphere": (x, x, x)}
        signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
        if solid.kind == "sphere":
            corners = T[:3, 3] + signs * x
        else:
            corners = transform(T, signs * np.array(half[solid.kind]))
        yield robot.n, placed.distance, corners.min(axis=0), corners.max(axis=0)


def body_distance(points, q=Q):
    """(n,) [m] of (n, 3) points in base to the body."""
    poses = link_poses(ROBOT_, q)
    return np.min([f(transform(inverse(poses[k]), points)) for k, f, _, _ in parts()], axis=0)


def test_each_part_has_a_field_that_reaches_as_far_as_it_is_asked():
    fields = body_fields(ROBOT_)
    everything = list(parts())
    assert fields.link.tolist() == [link for link, *_ in everything]
    assert len(fields.values) == np.prod(fields.shape, axis=1).sum()
    for m, (_, distance, low, high) in enumerate(everything):
        first = fields.T_link_grid[m, :3, 3]
        last = first + (fields.shape[m] - 1) * CELL
        assert (first <= low - BAND + 1e-9).all()
        assert (last >= high + BAND - 1e-9).all()
        assert (first > low - BAND - 3 * CELL).all()
        assert (last < high + BAND + 4 * CELL).all()
        nodes = np.stack(np.meshgrid(*map(np.arange, fields.shape[m]), indexing="ij"), -1)
        exact = distance(nodes.reshape(-1, 3) * CELL + first)
        start = fields.offset[m]
        own = fields.values[start : start + len(exact)]
        known = exact < BAND
        assert own[known] == pytest.approx(exact[known], abs=1e-6)
        assert (own[~known] >= BAND - 1e-6).all()


def test_the_field_of_a_mesh_is_signed():
    """A closed box of triangles with a box inside that makes no hole."""
    box = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
         [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )  # fmt: skip
    size, inner = np.array([0.16, 0.11, 0.13]), np.array([0.02, 0.03, 0.02])
    meshes = [(box * size, faces), (0.052 + box * inner, faces)]
    field, corner = _field(meshes, [])
    nodes = np.stack(np.meshgrid(*map(np.arange, field.shape), indexing="ij"), -1) * CELL + corner
    whole = Solid("box", "box", tuple(size), make_pose(translation=0.5 * size))
    exact = whole.distance(nodes.reshape(-1, 3)).reshape(field.shape)
    clear = np.abs(exact) > 1e-6
    assert ((field < 0) == (exact < 0))[clear].all()
    near = (exact > -0.01) & (exact < BAND)
    assert field[near] == pytest.approx(exact[near], abs=1e-5)


def test_the_pose_of_the_body_and_how_fast_it_is_at_most():
    filter_ = SelfFilter(ROBOT_)
    body = filter_.pose(Q, RATES)
    h = 1e-6
    before, after = (filter_.pose(Q + s * h * RATES, 0 * RATES) for s in (-1, 1))
    speed = np.linalg.norm(after.corners - before.corners, axis=2) / (2 * h)
    assert body.speed == pytest.approx(speed.max(axis=1), abs=1e-6)
    poses = link_poses(ROBOT_, Q)
    for m, (link, _, low, high) in enumerate(parts()):
        in_link = transform(inverse(poses[link]), body.corners[m])
        first = filter_.fields.T_link_grid[m, :3, 3]
        last = first + (filter_.fields.shape[m] - 1) * CELL
        assert in_link.min(axis=0) == pytest.approx(first)
        assert in_link.max(axis=0) == pytest.approx(last)
        assert (in_link.min(axis=0) < low).all()
        assert (in_link.max(axis=0) > high).all()
        in_cells = transform(body.T_cells_base[m], body.corners[m])
        assert in_cells.min(axis=0) == pytest.approx([0, 0, 0], abs=1e-9)
        assert in_cells.max(axis=0) == pytest.approx(filter_.fields.shape[m] - 1)


@pytest.mark.parametrize(("rates", "stamp"), [(0.0, 0.004), (4.0, 0.004), (4.0, 0.1)])
def test_a_pixel_is_the_arm_within_the_tolerance(rates, stamp):
    """A board right before the arm at all depths: what is told from it, and by how much."""
    filter_ = SelfFilter(ROBOT_)
    info = scenes.camera_info("cam", (1.2, -0.9, 1.0), (0.3, 0.1, 0.4), size=(96, 80))
    T, lens = info.T_mount_camera, DepthLens(info.depth, 5.0)
    arm = scenes.ray_cast(info.depth, T, scenes.arm_solids(ROBOT_, Q))
    rng = np.random.default_rng(0)
    nearer = -0.05 if stamp < 0.1 else -0.12
    depth = (arm + rng.uniform(nearer, 0.01, arm.shape)).astype(np.float32)
    label = np.isfinite(depth).astype(np.uint8)
    label[::7] = 0
    usable = label == VALID
    noise = np.array([0.001, 0.0005, 0.0005])
    body = filter_.pose(Q, rates * RATES)
    found = filter_.label(depth, label, lens, T, body, (0.006, 0.004), stamp, noise, sigmas=2.0)
    assert found == (label == ROBOT).sum()
    assert ((label == ROBOT) <= usable).all()
    assert (label[~usable] == 0).all()
    z = depth[usable].astype(float)
    points = transform(T, np.column_stack([lens.rays[usable].astype(float) * z[:, None], z]))
    away = body_distance(points)
    sure = 0.004 * z + 2.0 * (noise[0] + noise[1] * z + noise[2] * z * z)
    poses = link_poses(ROBOT_, Q)
    each = [f(transform(inverse(poses[k]), points)) for k, f, _, _ in parts()]
    # However fast the arm is: no more than the field knows.
    slip = np.minimum(0.006 + body.speed * stamp, BAND - 0.01)
    which = np.argmin(np.subtract(each, slip[:, None]), axis=0)
    away, sure = np.array(each)[which, np.arange(len(z))], sure + slip[which]
    own = label[usable] == ROBOT
    assert own[away < sure - WORST].all()
    assert not own[away > sure + WORST].any()
    assert own.sum() > 30
    assert (~own).sum() > 30


def test_voxels_near_the_body_and_filled_by_it():
    filter_ = SelfFilter(ROBOT_)
    grid = VoxelGrid(np.array([-0.2, -0.2, 0.1]), 0.03, (20, 26, 20))  # ends within the arm's reach
    near, filled = np.zeros((2, *grid.shape), np.uint8)
    listed = np.zeros(near.size, np.int32)
    limits = (0.035, 0.005, -0.02)
    count = filter_.mark(grid, filter_.pose(Q, RATES), limits, near, filled, listed)
    index = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), -1).reshape(-1, 3)
    away = body_distance(grid.center(index)).reshape(grid.shape)
    assert sorted(listed[:count]) == np.flatnonzero(near).tolist()
    for marked, limit in zip((near > 0, filled >= MIDDLE, filled == WHOLE), limits):
        assert marked[away < limit - WORST].all()
        assert not marked[away > limit + WORST].any()
        assert marked.any()


def test_a_tool_without_a_mesh_on_an_arm_with_meshes_is_filtered_by_its_capsules():
    bare = load_robot("ur5")
    tool = replace(load_tool("pen"), meshes=())
    carries = bare.with_tool(tool)
    own, with_tool = body_fields(bare), body_fields(carries)
    last = np.flatnonzero(with_tool.link == bare.n)
    assert len(with_tool.link) == len(own.link) + (own.link != bare.n).all()

    def least(fields, rows, point):
        away = [np.inf]
        for m in rows:
            index = np.round((point - fields.T_link_grid[m, :3, 3]) / CELL).astype(int)
            if ((index >= 0) & (index < fields.shape[m])).all():
                at = fields.offset[m] + np.ravel_multi_index(tuple(index), fields.shape[m])
                away.append(fields.values[at])
        return min(away)

    new = slice(len(bare.capsules.radius), None)
    ends = np.concatenate([carries.capsules.start[new], carries.capsules.end[new]])
    radii = np.tile(carries.capsules.radius[new], 2)
    for point, radius in zip(ends, radii):
        assert least(with_tool, last, point) < -radius + CELL
    tip = ends[np.argmax(np.linalg.norm(ends, axis=1))]
    assert least(own, np.flatnonzero(own.link == bare.n), tip) == np.inf

"""Compiled loops against plain-numpy twins and properties."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from armsight.simulation.kernels import (
    drive_step,
    gap_bounds,
    part_poses,
    quaternion,
    resample_depth,
)
from armsight.simulation.noise_kernels import _cosine, _lit_by_projector, _row_shape, interfered

DT = 0.002


def drive_twin(target, braking, q, v, lower, upper, acceleration, brake, dt):
    """The drives' reference in plain numpy."""
    step = brake * dt

    def stopping(room):
        room = np.maximum(room, 0.0)
        speed = np.sqrt(0.25 * step**2 + 2 * brake * room) - 0.5 * step
        return np.where(room > 0, speed, 0.0)

    up, down = stopping(upper - q), -stopping(q - lower)
    wanted = np.zeros_like(target) if braking else np.clip(target, down, up)
    change = (brake if braking else acceleration) * dt
    new = v + np.clip(wanted - v, -change, change)
    new = np.where(new > up, np.maximum(up, v - step), new)
    new = np.where(new < down, np.minimum(down, v + step), new)
    q = q + new * dt
    v = np.where(q > upper, np.minimum(new, 0), np.where(q < lower, np.maximum(new, 0), new))
    return np.clip(q, lower, upper), v


def test_drive_step_is_its_twin():
    rng = np.random.default_rng(0)
    lower, upper = np.array([-1.0, -2.0, -0.3]), np.array([1.0, 0.5, 0.3])
    acceleration, brake = np.array([3.0, 4.0, 5.0]), np.array([6.0, 5.0, 5.0])
    q, v = np.zeros(3), np.zeros(3)
    q2, v2 = q.copy(), v.copy()
    for i in range(3000):
        if i % 150 == 0:
            target, braking = rng.uniform(-2, 2, 3), bool(rng.random() < 0.2)
        drive_step(target, braking, q, v, lower, upper, acceleration, brake, DT)
        q2, v2 = drive_twin(target, braking, q2, v2, lower, upper, acceleration, brake, DT)
        assert np.allclose(q, q2, atol=1e-12)
        assert np.allclose(v, v2, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    targets=st.lists(
        st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.booleans()), min_size=1, max_size=12
    ),
    hold=st.integers(5, 400),
)
def test_drives_keep_every_limit(targets, hold):
    lower, upper = np.array([-0.8, -0.2]), np.array([0.5, 0.2])
    acceleration, brake = np.array([4.0, 6.0]), np.array([8.0, 6.0])
    q, v = np.zeros(2), np.zeros(2)
    for a, b, braking in targets:
        target = np.array([a, b])
        for _ in range(hold):
            before_q, before_v = q.copy(), v.copy()
            drive_step(target, braking, q, v, lower, upper, acceleration, brake, DT)
            assert np.all(q >= lower)
            assert np.all(q <= upper)
            # never faster than asked or than before, never harder than the brakes
            assert np.all(np.abs(v) <= np.maximum(np.abs(target), np.abs(before_v)) + 1e-12)
            stopped_at_limit = (q == lower) | (q == upper)
            change = np.abs(v - before_v)
            assert np.all((change <= brake * DT + 1e-9) | stopped_at_limit)
            # a clamp at the limit cuts off less than one step's braking
            assert np.all(change <= brake * DT * 2 + 1e-9)
            fastest = np.maximum(np.abs(v), np.abs(before_v) + brake * DT)
            assert np.all(np.abs(q - before_q) <= fastest * DT + 1e-12)


def test_quaternion_against_scipy():
    rotations = Rotation.random(200, rng=np.random.default_rng(1))
    half_turns = Rotation.from_rotvec(np.pi * np.eye(3))
    for R in (*rotations.as_matrix(), *half_turns.as_matrix(), np.eye(3)):
        out = np.empty(4)
        quaternion(np.ascontiguousarray(R), out)
        assert out[0] >= 0
        assert np.linalg.norm(out) == pytest.approx(1)
        assert np.allclose(Rotation.from_quat(out[[1, 2, 3, 0]]).as_matrix(), R, atol=1e-9)


def test_part_poses_are_right_handed_along_the_bone():
    rng = np.random.default_rng(2)
    joints = rng.uniform(-1, 1, (19, 3))
    joints[5] = joints[4] + [0.0, 0.3, 0.0]  # along the person's left
    joints[7] = joints[6]  # a bone of no length
    start, end = np.array([0, 2, 4, 6]), np.array([1, 3, 5, 7])
    turn = np.array([0, 1, 0, 1])
    left = np.array([0.0, 1.0, 0.0])
    position, wxyz = np.empty((4, 3)), np.empty((4, 4))
    part_poses(joints, start, end, turn, left, position, wxyz)
    R = Rotation.from_quat(wxyz[:, [1, 2, 3, 0]]).as_matrix()
    assert np.allclose(position, joints[start])
    bone = joints[end] - joints[start]
    bone[3] = [0, 0, 1]
    assert np.allclose(R[:, :, 2], bone / np.linalg.norm(bone, axis=1)[:, None])
    assert np.allclose(np.linalg.det(R), 1)
    assert abs(R[0, :, 0] @ left) < 1e-9  # x is square to the left
    assert R[1, 2, 0] > 0  # the hand's back is up


def test_resampling_is_exact_on_planes_and_nearest_across_borders():
    """Plane n.p = d through a shifted lens: 1/z is linear, so interpolation adds no error."""
    rng = np.random.default_rng(3)
    height, width, h, w = 40, 50, 30, 36
    v, u = np.mgrid[0:height, 0:width].astype(float)
    inverse_depth = 0.5 + 0.002 * u - 0.001 * v
    near, far = 0.05, 25.0
    offset, factor = 0.5 * (far + near) / (far - near) - 0.5, far * near / (far - near)
    ids = np.where(u < 20, 1, 2).astype(np.uint32)
    ids[:5] = 0
    raw = (factor * inverse_depth - offset).astype(np.float32)
    raw[:, 20:] += np.float32(0.001)
    map_u = rng.uniform(1, width - 2.01, (h, w))
    map_v = rng.uniform(1, height - 2.01, (h, w))
    column, line = np.floor(map_u), np.floor(map_v)
    depth, geom = np.empty((h, w), np.float32), np.empty((h, w), np.int16)
    resample_depth(
        np.ascontiguousarray(raw[::-1]),
        np.ascontiguousarray(ids[::-1]),
        ((height - 1 - line) * width + column).astype(np.int32),
        (map_u - column).astype(np.float32),
        (map_v - line).astype(np.float32),
        np.array([-1, 7, 9], np.int16),
        offset,
        factor,
        (0, h, 0, w),
        depth,
        geom,
    )
    r, c = np.floor(map_v + 0.5).astype(int), np.floor(map_u + 0.5).astype(int)
    expected_geom = np.array([-1, 7, 9])[ids[r, c]]
    assert np.array_equal(geom, expected_geom)
    assert np.array_equal(np.isnan(depth), expected_geom < 0)
    inside = (geom == 7) & (column < 18) & (line > 5)
    plane = 1.0 / (0.5 + 0.002 * map_u - 0.001 * map_v)
    assert np.allclose(depth[inside], plane[inside], rtol=2e-6)
    border = (column == 19) & (line > 6)
    nearest = factor / (raw[r, c].astype(float) + offset)
    assert np.allclose(depth[border], nearest[border], rtol=1e-5)


def test_gap_bounds_against_sampling():
    rng = np.random.default_rng(4)
    centers, radii = rng.uniform(-1, 1, (7, 3)), rng.uniform(0.01, 0.1, 7)
    a, b = rng.uniform(-1, 1, (5, 3)), rng.uniform(-1, 1, (5, 3))
    b[0] = a[0]
    widths = rng.uniform(0.01, 0.1, 5)
    out = np.empty((7, 5))
    gap_bounds(centers, radii, a, b, widths, out)
    t = np.linspace(0, 1, 4001)[:, None, None]
    axis = (1 - t) * a + t * b
    distance = np.linalg.norm(centers[None, :, None] - axis[:, None], axis=-1).min(0)
    assert np.allclose(out, distance - radii[:, None] - widths, atol=1e-3)


def tilted_plane(h=24, w=32, slope=(0.4, -0.2)):
    """(z, rays) of the plane z = 1.5 + slope . (x, y)."""
    v, u = np.mgrid[0:h, 0:w].astype(float)
    rays = np.stack([(u - w / 2) / 40, (v - h / 2) / 40]).astype(np.float32)
    z = 1.5 / (1 - slope[0] * rays[0] - slope[1] * rays[1])
    return z.astype(np.float32), np.ascontiguousarray(rays)


def test_incidence_of_a_plane():
    z, rays = tilted_plane()
    normal = np.array([0.4, -0.2, -1.0])
    normal /= np.linalg.norm(normal)
    directions = np.stack([rays[0], rays[1], np.ones_like(rays[0])], -1)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    expected = np.abs(directions @ normal)
    z[10, 10] = np.nan
    cosines, rough = np.empty(32, np.float32), np.empty(32, np.uint8)
    for v in range(24):
        _row_shape(z, rays, v, cosines, rough)
        seen = ~np.isnan(z[v])
        assert np.allclose(cosines[seen], expected[v][seen], atol=3e-3)
        slow = [_cosine(z, rays, v, u) for u in range(32)]
        assert np.allclose(cosines[seen], np.array(slow)[seen], atol=1e-6)
    _row_shape(z, rays, 10, cosines, rough)
    assert rough[9]
    assert rough[11]
    assert not rough[15]


def test_projector_shadow_lies_left_of_what_stands_in_front():
    """A board at 1 m before a wall at 2 m; geometry by hand, projector 10 cm to the right."""
    u = np.arange(200)
    rays = ((u - 99.5) / 200).astype(np.float32)
    depth = np.full(200, 2.0, np.float32)
    board = (rays > -0.1) & (rays < 0.1)
    depth[board] = 1.0
    lit = np.empty(200, bool)
    _lit_by_projector(depth, rays, 0.1, lit)
    # The projector's ray past the board's left edge, x = -0.1 at z = 1, meets the wall at
    # x = 0.1 + 2 (-0.1 - 0.1) = -0.3: the wall is dark from the camera's -0.15 to -0.1.
    expected = ~((rays > -0.15) & (rays <= -0.1))
    assert np.sum(lit != expected) <= 1


def test_interference_reaches_only_what_the_other_sees():
    h, w = 30, 40
    lens = np.array([40.0, 40.0, 19.5, 14.5])
    v, u = np.mgrid[0:h, 0:w].astype(float)
    rays = np.stack([(u - 19.5) / 40, (v - 14.5) / 40]).astype(np.float32)
    depth = np.full((h, w), 2.0, np.float32)
    other = np.full((h, w), 2.0, np.float32)
    other[:, :10] = 1.0  # something in front shades the wall there
    T = np.eye(4)
    T[0, 3] = 0.5  # the other sits to the left: its picture of a point lies further right
    mask = np.zeros((h, w), bool)
    interfered(depth, rays, T, other, lens, mask)
    expected = np.zeros((h, w), bool)
    for row in range(h):
        for column in range(w):
            x = rays[0, row, column] * 2.0 + 0.5
            c = int(np.floor(40 * x / 2.0 + 19.5 + 0.5))
            expected[row, column] = c < w and other[row, min(c, w - 1)] >= 1.9
    assert np.array_equal(mask, expected)

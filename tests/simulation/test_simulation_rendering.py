"""Depth and segmentation against analytic rays; lenses against PinholeCamera; threads."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from simulation_cells import camera

from armsight.devices.camera_models import CAMERA_MODELS
from armsight.errors import ArmsightError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, inverse, look_at, make_pose
from armsight.geometry.shapes import Solid
from armsight.simulation import gl as gl_module
from armsight.simulation.lens import render_lens
from armsight.simulation.spec import WorldSpec
from armsight.simulation.static_background import reach_of_spheres
from armsight.simulation.world import SimulatedWorld

SOLIDS = (
    Solid("ball", "sphere", (0.12, 0, 0), make_pose(None, (0.9, 0.3, 0.5))),
    Solid("crate", "box", (0.3, 0.2, 0.4), from_rpy((0.1, 0.2, 0.7), (0.9, -0.3, 0.3))),
    Solid("can", "cylinder", (0.1, 0.3, 0), from_rpy((0.3, 0.5, 0), (1.3, 0.0, 0.6))),
)
EYE, TARGET = (2.4, 0.8, 1.5), (0.9, 0.0, 0.35)


@pytest.fixture(scope="module")
def scene(gl, robot):
    from armsight.simulation.spec import ArmSpec

    spec = ArmSpec(robot, make_pose(None, (-3.0, 0, 0)), robot.home)
    with SimulatedWorld(WorldSpec(spec, static=SOLIDS)) as world:
        yield world


def traced(lens, T_world_camera):
    """Depth and index of the nearest surface by analytic rays: 0 floor, 1.. the solids."""
    rays = np.concatenate([lens.rays, np.ones((lens.height, lens.width, 1))], axis=2)
    d = rays @ T_world_camera[:3, :3].T
    o = T_world_camera[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(d[..., 2] < 0, -o[2] / d[..., 2], np.inf)
        floor = np.where(floor < 20.0, floor, np.inf)
        hits = [floor]
        for solid in SOLIDS:
            T = inverse(solid.T_frame_solid)
            hits.append(_hit(solid, T[:3, :3] @ o + T[:3, 3], d @ T[:3, :3].T))
    stacked = np.stack(hits)
    return stacked.min(0), stacked.argmin(0)


def d_up(lens, T_world_camera):
    """(h, w) rays that rise and hit none of the solids: the sky."""
    rays = np.concatenate([lens.rays, np.ones((lens.height, lens.width, 1))], axis=2)
    rising = (rays @ T_world_camera[:3, :3].T)[..., 2] > 0
    return rising & ~np.isfinite(traced(lens, T_world_camera)[0])


def _hit(solid, o, d):
    """Ray parameter of the first hit with a solid about its own origin, inf for none."""
    if solid.kind == "sphere":
        return _quadratic((d**2).sum(-1), d @ o, o @ o - solid.size[0] ** 2)
    if solid.kind == "box":
        half = 0.5 * np.array(solid.size)
        t1, t2 = (-half - o) / d, (half - o) / d
        near, far = np.minimum(t1, t2).max(-1), np.maximum(t1, t2).min(-1)
        return np.where((near <= far) & (near > 0), near, np.inf)
    r, half = solid.size[0], 0.5 * solid.size[1]
    a, b = (d[..., :2] ** 2).sum(-1), d[..., :2] @ o[:2]
    side = _quadratic(a, b, o[:2] @ o[:2] - r * r)
    side = np.where(np.abs(o[2] + side * d[..., 2]) <= half, side, np.inf)
    for cap in (-half, half):
        t = (cap - o[2]) / d[..., 2]
        inside = ((o[:2] + t[..., None] * d[..., :2]) ** 2).sum(-1) <= r * r
        side = np.minimum(side, np.where(inside & (t > 0), t, np.inf))
    return side


def _quadratic(a, b, c):
    root = b * b - a * c
    t = (-b - np.sqrt(np.maximum(root, 0))) / a
    return np.where((root > 0) & (t > 0), t, np.inf)


LENSES = [
    PinholeCamera.from_fov(320, 240, np.deg2rad(70), np.deg2rad(55)),
    CAMERA_MODELS["kinect_v2"].depth.scaled(0.5),
    CAMERA_MODELS["f200"].depth.scaled(0.5),
    replace(CAMERA_MODELS["kinect_v1"].depth, fx=290.0, fy=310.0),
]


@pytest.mark.parametrize("lens", LENSES, ids=["ideal", "kinect_v2", "f200", "unequal"])
def test_depth_and_segmentation_against_rays(scene, lens):
    T = look_at(EYE, TARGET)
    shot = scene.renderer.take(scene._data, T, lens)
    picture = scene.renderer.depth(shot, lens)
    scene.renderer.give_back(shot)
    z, owner = traced(lens, T)
    names = ["floor", *(s.name for s in SOLIDS)]
    parts = scene._cell.parts
    seen = np.array([names.index(p.owner) if p.owner in names else -1 for p in parts] + [-1])
    geom = seen[picture.geom]
    visible = np.isfinite(z) & (z < 20)
    assert np.mean((geom == owner)[visible]) > 0.99  # borders and facets of round things
    assert np.all(picture.geom[d_up(lens, T)] < 0)
    assert np.array_equal(np.isnan(picture.depth), picture.geom < 0)
    error = np.abs(picture.depth - z)
    # Planes are exact but at borders, where the nearest pixel counts; round things have facets of
    # up to 1 mm, seen larger where they turn away.
    for name, share, tolerance in (
        ("floor", 95, 6e-4),
        ("crate", 50, 1e-4),
        ("ball", 75, 2.5e-3),
        ("can", 75, 2.5e-3),
    ):
        mine = visible & (geom == names.index(name)) & (owner == names.index(name)) & (z < 4.5)
        assert mine.sum() > 100
        assert np.percentile(error[mine], share) < tolerance, name


@pytest.mark.parametrize("name", sorted(CAMERA_MODELS))
def test_render_lens_agrees_with_the_camera_model(name):
    """Back-project a pixel with the distorted lens, look it up in the pinhole's picture."""
    for lens in (CAMERA_MODELS[name].depth, CAMERA_MODELS[name].color.scaled(0.25)):
        view = render_lens(lens)
        rng = np.random.default_rng(0)
        u, v = rng.integers(0, lens.width, 300), rng.integers(0, lens.height, 300)
        rays = lens.rays[v, u]
        points = np.concatenate([rays, np.ones((300, 1))], axis=1) * rng.uniform(0.3, 4, (300, 1))
        assert np.allclose(lens.project(points), np.stack([u, v], 1), atol=1e-3)
        there = view.pinhole.project(points)
        assert np.allclose(there, np.stack([view.map_u[v, u], view.map_v[v, u]], 1), atol=2e-3)
        assert view.map_u.min() >= 0
        assert view.map_u.max() <= view.pinhole.width - 2
        assert view.map_v.min() >= 0
        assert view.map_v.max() <= view.pinhole.height - 2
        assert view.corner.min() >= view.pinhole.width  # the line below is inside as well
        assert view.corner.max() < view.pinhole.width * view.pinhole.height - 1


def test_color_lens_sees_things_where_they_project(scene):
    """The centre of a red ball in the colour picture is where the distorted lens projects it."""
    lens = CAMERA_MODELS["kinect_v2"].color.scaled(0.33)
    T = look_at(EYE, TARGET)
    image = scene.picture(T, lens)
    assert image.shape == (lens.height, lens.width, 3)
    assert image.dtype == np.uint8
    depth = scene.renderer.depth(scene.renderer.take(scene._data, T, lens), lens)
    crate = np.array([p.owner == "crate" for p in scene._cell.parts] + [False])[depth.geom]
    grey = image.astype(float).mean(2)
    # Colour jumps where segmentation says that the crate ends, and hardly anywhere else nearby.
    step = np.abs(np.diff(grey, axis=1))
    border = crate[:, 1:] != crate[:, :-1]
    inside = crate[:, 1:] & crate[:, :-1]
    assert np.median(step[border]) > 8 * np.median(step[inside])
    again = scene.picture(T, lens)
    assert np.array_equal(image, again)


@pytest.mark.parametrize("target", [TARGET, (-3.0, 0.0, 0.4)])
def test_a_camera_at_work_sees_what_the_still_shows(scene, target):
    """Coarser meshes, shadows and edges leave all but a few pixels alike."""
    lens = PinholeCamera.from_fov(360, 240, 0.7, 0.5)
    T = look_at(np.add(target, (1.6, 0.7, 1.0)), target)
    shot = scene.renderer.take(scene._data, T, lens, "color")
    work = scene.renderer.color(shot, lens).astype(int)
    scene.renderer.give_back(shot)
    still = scene.picture(T, lens).astype(int)
    assert np.ptp(still) > 100
    assert (np.abs(work - still).max(axis=2) > 24).mean() < 0.03
    assert abs(work.mean() - still.mean()) < 1.0


def test_pictures_from_any_thread(scene):
    lens = LENSES[0]
    T = look_at(EYE, TARGET)
    here = scene.picture(T, lens)
    found = []
    threads = [
        threading.Thread(target=lambda: found.append(scene.picture(T, lens))) for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 3
    assert all(np.array_equal(here, image) for image in found)


def test_pictures_larger_than_any_before(scene):
    lens = PinholeCamera.from_fov(1300, 900, 1.2, 0.9)
    assert scene.picture(look_at(EYE, TARGET), lens).shape == (900, 1300, 3)
    small = scene.picture(look_at(EYE, TARGET), LENSES[0])
    assert small.shape == (240, 320, 3)


def test_flange_camera_moves_with_the_arm(gl, arm_spec):
    """The camera's own pose from kinematics by MuJoCo against the depth of the floor it sees."""
    with SimulatedWorld(WorldSpec(arm_spec)) as world:
        T_world_flange = world.truth.link_poses()[-1] @ arm_spec.robot.T_last_flange
    eye = T_world_flange[:3, 3] + [0.15, 0.1, 0.1]
    T_flange_camera = inverse(T_world_flange) @ look_at(eye, eye * [1.2, 1.2, 0.0])
    spec = camera(name="wrist")
    info = replace(spec.info, mounted_on="flange", T_mount_camera=T_flange_camera)
    wrist = replace(spec, info=info, T_mount_camera_declared=T_flange_camera)
    with SimulatedWorld(WorldSpec(arm_spec, cameras=(wrist,))) as world:
        depths = []
        for _ in range(2):
            for _ in range(25):
                world.arm.command_velocity(np.array([0, 0.4, -0.4, 0, 0, 0]))
                world.advance(world.clock.now() + 0.02)
            frame = world.cameras[0].read()
            T = world.truth.link_poses()[-1] @ arm_spec.robot.T_last_flange @ T_flange_camera
            lens = info.depth
            row, column = lens.height // 2, lens.width // 2
            ray = np.append(lens.rays[row, column], 1.0)
            direction = T[:3, :3] @ ray
            # the frame is a little older than the pose
            assert frame.depth[row, column] == pytest.approx(-T[2, 3] / direction[2], abs=0.03)
            depths.append(frame.depth[row, column])
        assert abs(depths[1] - depths[0]) > 0.01


def test_no_opengl_says_what_to_install(monkeypatch):
    def broken(*_):
        raise AttributeError("'NoneType' object has no attribute 'eglQueryString'\nmore")

    from mujoco.rendering.classic import gl_context

    monkeypatch.setattr(gl_context, "GLContext", broken)
    with pytest.raises(ArmsightError) as caught:
        gl_module.OpenGLContext()
    message = str(caught.value)
    assert "\n" not in message
    for word in ("libegl1", "libgl1-mesa-dri", "libopengl0", "eglQueryString"):
        assert word in message


def test_check_opengl_names_the_renderer(gl):
    assert gl_module.check_opengl() == gl
    assert len(gl) > 3


def test_a_fixed_camera_sees_the_same_as_one_that_draws_all_anew(scene):
    """What never moves is drawn once; merged with what moves, the picture is that of one pass."""
    lens, T = CAMERA_MODELS["kinect_v2"].depth.scaled(0.5), look_at(EYE, TARGET)
    for until in (0.0, 0.4, 0.8):
        scene.advance(until)
        whole = scene.renderer.take(scene._data, T, lens)
        expected = scene.renderer.depth(whole, lens)
        parted = scene.renderer.take(scene._data, T, lens, fixed=True)
        found = scene.renderer.depth(parted, lens)
        assert parted.reach[0] < parted.reach[1]
        assert parted.scene.ngeom < whole.scene.ngeom
        assert np.array_equal(found.depth, expected.depth, equal_nan=True)
        assert np.array_equal(found.geom, expected.geom)
        scene.renderer.give_back(whole)
        scene.renderer.give_back(parted)
    away = look_at(EYE, 2 * np.asarray(EYE) - TARGET)  # nothing that moves is in view
    parted = scene.renderer.take(scene._data, away, lens, fixed=True)
    whole = scene.renderer.take(scene._data, away, lens)
    assert parted.reach == (0, 0, 0, 0)
    found, expected = scene.renderer.depth(parted, lens), scene.renderer.depth(whole, lens)
    assert np.array_equal(found.depth, expected.depth, equal_nan=True)


def test_reach_of_spheres_holds_every_point_of_them():
    rng = np.random.default_rng(5)
    lens = PinholeCamera.from_fov(320, 240, np.deg2rad(70), np.deg2rad(55))
    T = look_at((0.3, -0.4, 1.0), (0.1, 0.5, 0.2))
    for _ in range(200):
        n = rng.integers(1, 4)
        centers, radii = rng.uniform(-3, 3, (n, 3)), rng.uniform(0.01, 0.8, n)
        top, bottom, left, right = reach_of_spheres(centers, radii, T, lens)
        skin = rng.normal(size=(n, 4000, 3))
        skin /= np.linalg.norm(skin, axis=2, keepdims=True)
        skin = centers[:, None] + radii[:, None, None] * skin
        p = (skin.reshape(-1, 3) - T[:3, 3]) @ T[:3, :3]
        p = p[p[:, 2] > 0.01]
        u, v = lens.fx * p[:, 0] / p[:, 2] + lens.cx, lens.fy * p[:, 1] / p[:, 2] + lens.cy
        u, v = np.round(u), np.round(v)
        seen = (u >= 0) & (u < lens.width) & (v >= 0) & (v < lens.height)
        assert np.all((u[seen] >= left) & (u[seen] < right))
        assert np.all((v[seen] >= top) & (v[seen] < bottom))


def test_another_light_changes_pictures_as_much_as_it_is_told_to(gl, robot):
    from armsight.simulation.spec import ArmSpec

    lens = PinholeCamera.from_fov(160, 120, 1.05, 0.82)
    T = look_at(EYE, TARGET)
    spec = WorldSpec(ArmSpec(robot, make_pose(None, (-3.0, 0, 0)), robot.home), static=SOLIDS)
    with SimulatedWorld(spec) as world:
        told = world.picture(T, lens).astype(float)
        world.relight([0.5] * world.lamps, 0.5)
        half = world.picture(T, lens).astype(float)
        lit = (told > 60) & (told < 250) & (half > 10)
        assert lit.mean() > 0.5
        assert np.median(half[lit] / told[lit]) == pytest.approx(0.5, abs=0.05)
        with pytest.raises(ValueError, match="1 factors of brightness for"):
            world.relight([1.0], 1.0)

"""The measurement model against differences, OpenCV and its own invariants."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from armsight.calibration import arm, se3
from armsight.calibration.model import Model, project
from armsight.calibration.problem import ArmView, Freedom, Lens, Rig, Sighting
from armsight.calibration.robot_errors import RobotErrors
from armsight.calibration.solver import normal_equations
from armsight.calibration.start import find_start
from armsight.calibration.synthetic import make_cell, observe, random_views
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, log


@pytest.fixture(scope="module")
def problem(arm5):
    rng = np.random.default_rng(3)
    cell = make_cell(arm5, rng)
    joints = random_views(cell, 6, rng)
    problem = find_start(observe(cell, joints, rng), rng).problem
    twist = rng.normal(0, 0.05, (len(problem.views), 6))
    views = [replace(v, twist=t) for v, t in zip(problem.views, twist)]
    # A camera on the arm that looks at a board on the table, and a board held by hand.
    wrist = Rig("wrist", "flange", exp([0.02, 0.01, 0.05, 0.1, 0.2, 0.1]))
    lens = Lens("wrist color", 3, PinholeCamera(640, 480, 500, 500, 319.5, 239.5))
    table = replace(
        problem.boards[0],
        name="table",
        mount="base",
        T_mount_board=views[0].T_base_flange @ wrist.T_mount_rig @ exp([0, 0, 0.6, 0.2, 0.1, 0]),
    )
    views.append(ArmView(exp([0.4, 0, 0.4, 0.1, 0.2, 0.3]), free=True))
    held = problem.rigs[0].T_mount_rig @ exp([0, 0, 0.8, 0.2, 0.1, 0.3])
    views.append(ArmView(held, free=True))
    few = np.arange(0, 24, 3)
    extra = (
        Sighting(0, 6, 1, few, rng.uniform(100, 400, (len(few), 2)), 0.3),
        Sighting(len(views) - 1, 0, 0, few, rng.uniform(100, 400, (len(few), 2)), 0.3),
        Sighting(len(views) - 1, 1, 0, few, rng.uniform(100, 400, (len(few), 2)), 0.3),
    )
    return replace(
        problem,
        rigs=(*problem.rigs, wrist),
        lenses=(*problem.lenses, lens),
        boards=(*problem.boards, table),
        views=tuple(views),
        sightings=(*problem.sightings, *extra),
    )


def scattered(model, rng):
    step = rng.normal(0, 1e-3, model.size)
    return model.retract(model.start(), step, rng.normal(0, 1e-3, (len(model.view_free), 6)))


def test_derivatives_are_those_of_differences(problem, rng):
    model = Model(problem, Freedom(lens=True, robot=True, time=True))
    state = scattered(model, rng)
    lin = model.linearise(state)
    P = model.columns.shape[1]
    step = 1e-6
    for g in range(model.size):
        d = np.zeros(model.size)
        size = step * (
            1.0 if g >= model.offset_slice(0).start else max(1.0, abs(state.lens.ravel()[g]))
        )
        d[g] = size
        none = np.zeros((len(model.view_free), 6))
        plus = model.linearise(model.retract(state, d, none), False).residual
        minus = model.linearise(model.retract(state, -d, none), False).residual
        numeric = (plus - minus) / (2 * size)
        analytic = np.zeros_like(numeric)
        for f, local in zip(*np.nonzero(model.columns == g)):
            analytic[f] += lin.jacobian[f, :, :, local]
        scale = max(np.abs(numeric).max(), 1e-3)
        np.testing.assert_allclose(
            analytic / scale, numeric / scale, atol=2e-5, err_msg=model.labels[g]
        )
    for k in range(6):
        d = np.zeros((len(model.view_free), 6))
        d[:, k] = step
        plus = model.linearise(model.retract(state, np.zeros(model.size), d), False).residual
        minus = model.linearise(model.retract(state, np.zeros(model.size), -d), False).residual
        numeric = (plus - minus) / (2 * step)
        scale = np.abs(numeric).max()
        np.testing.assert_allclose(lin.jacobian[..., P + k] / scale, numeric / scale, atol=2e-5)


def test_every_unknown_has_a_name(problem):
    model = Model(problem, Freedom(lens=True, robot=True, time=True))
    assert len(model.labels) == model.size
    assert model.labels[model.theta_slice][0].startswith("zero of")
    assert model.labels[model.rig_slice(1)][0] == "camera right, x [m]"


def test_schur_complement_is_the_full_system(problem, rng):
    # Without the lone wrist camera: one sighting cannot tell its pose from its board's.
    model = Model(problem.only_lenses(range(6)), Freedom(lens=True, robot=True))
    normal, _ = normal_equations(model, scattered(model, rng), np.inf)
    g, v = len(normal.free), len(normal.views)
    full = np.zeros((g + 6 * v, g + 6 * v))
    full[:g, :g] = normal.H
    for k in range(v):
        at = slice(g + 6 * k, g + 6 * k + 6)
        full[at, at] = normal.H_view[k]
        full[:g, at] = normal.H_mixed[k]
        full[at, :g] = normal.H_mixed[k].T
    scale = 1 / np.sqrt(np.diag(full))
    full = full * scale[:, None] * scale
    inverse = np.linalg.inv(full)[:g, :g]
    reduced = normal.reduced() * scale[:g, None] * scale[:g]
    np.testing.assert_allclose(
        np.linalg.inv(reduced), inverse, rtol=1e-6, atol=1e-6 * abs(inverse).max()
    )


def test_projection_is_that_of_opencv(rng):
    camera = PinholeCamera(640, 480, 500, 510, 320, 241, (0.1, -0.2, 0.003, -0.002, 0.05))
    points = rng.uniform([-0.4, -0.3, 0.8], [0.4, 0.3, 1.4], (20, 3))
    vector = np.array([[500, 510, 320, 241, 0.1, -0.2, 0.003, -0.002, 0.05]])
    ours, _, _ = project(points[None], vector, False)
    theirs, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), camera.K, np.array(camera.distortion)
    )
    np.testing.assert_allclose(ours[0], theirs[:, 0], atol=1e-9)


def test_robot_errors_move_the_flange_as_they_say(arm5, rng):
    errors = RobotErrors(arm5)
    q = rng.uniform(-2, 2, (4, 6))
    theta = rng.normal(0, 1e-3, errors.size)
    _T, B = errors.flange_poses(q, theta)
    for k in range(errors.size):
        d = np.zeros(errors.size)
        d[k] = 1e-6
        plus, minus = errors.flange_poses(q, theta + d)[0], errors.flange_poses(q, theta - d)[0]
        numeric = se3.logs(se3.inverses(minus) @ plus) / 2e-6
        np.testing.assert_allclose(B[:, :, k], numeric, atol=1e-6)
    np.testing.assert_allclose(errors.flange_poses(q, 0 * theta)[0], arm.flange_poses(arm5, q))


def test_se3_stacks_agree_with_the_single_functions(rng):
    twists = rng.normal(0, 1, (20, 6))
    twists[0] *= 1e-9
    T = se3.exps(twists)
    np.testing.assert_allclose(T, [exp(x) for x in twists], atol=1e-12)
    np.testing.assert_allclose(se3.logs(T), [log(t) for t in T], atol=1e-9)
    x = rng.normal(0, 1, (20, 6))
    left = T @ se3.exps(x) @ se3.inverses(T)
    right = se3.exps(np.einsum("nij,nj->ni", se3.adjoints(T), x))
    np.testing.assert_allclose(left, right, atol=1e-9)


def test_log_derivative_is_that_of_differences(rng):
    x = rng.normal(0, 2e-3, (5, 6))
    D = se3.log_derivatives(x)
    for k in range(6):
        d = np.zeros((1, 6))
        d[0, k] = 1e-6
        plus = se3.logs(se3.exps(x) @ se3.exps(d))
        minus = se3.logs(se3.exps(x) @ se3.exps(-d))
        np.testing.assert_allclose(D[:, :, k], (plus - minus) / 2e-6, atol=1e-8)


def test_reach_arrives(arm5, rng):
    q = np.tile(arm5.home, (50, 1)) + rng.normal(0, 0.5, (50, 6))
    targets = arm.flange_poses(arm5, q)
    answer, ok = arm.reach(arm5, targets, np.tile(arm5.home, (50, 1)))
    assert ok.mean() > 0.8
    np.testing.assert_allclose(arm.flange_poses(arm5, answer[ok]), targets[ok], atol=3e-5)
    far = targets.copy()
    far[:, :3, 3] *= 10
    assert not arm.reach(arm5, far, q)[1].any()

"""The fit's step, edge by edge, beside one large least-squares problem in numpy."""

import numpy as np
import pytest
from test_fit_light import looks_from

from armsight.charging import fit as module
from armsight.charging.fit import LIGHT, MAKE, FitOptions, spaced_curves
from armsight.charging.ports.table import PORTS


@pytest.mark.parametrize("baseline", [0.05, 0.5])
def test_a_step_is_that_of_the_whole_system(baseline: float) -> None:
    """Pose, make and light of all edges and pictures in one matrix, what is known as rows of it."""
    looks, T = looks_from(baseline)
    model = spaced_curves(PORTS["type2"], looks, T, FitOptions())
    rng = np.random.default_rng(0)
    make = rng.normal(0.0, 1e-4, (len(model.rims), MAKE))
    rows = [module._predict(view, model, T, make) for view in looks]
    offsets = [rng.normal(0.0, 0.2, len(model.points)) for _ in looks]
    alike = module._alike(looks, T)
    step, information, new = module._solve(model, rows, offsets, make, alike)

    k, n, views = len(model.rims), len(model.points), len(looks)
    r = np.concatenate(offsets)
    spread = max(1.4826 * float(np.median(np.abs(r))), module.POINT_SIGMA)
    root = np.sqrt(1.0 / np.maximum(np.abs(r) / (1.5 * spread), 1.0)) / spread
    A = np.zeros((n * views, 6 + k * (MAKE + LIGHT * views)))
    for j in range(n * views):
        v, point = divmod(j, n)
        row, rim = rows[v], model.rim[point]
        x, y = row.normals[point]
        at = 6 + rim * (MAKE + LIGHT * views)
        A[j, :6] = row.by_pose[point]
        A[j, at : at + MAKE] = row.by_make[point]
        lit = at + MAKE + LIGHT * v
        A[j, lit : lit + LIGHT] = x, y, 1.0, x * x - y * y, 2.0 * x * y
    light = (module.SHIFT_SIGMA, module.SHIFT_SIGMA, module.SWELL_SIGMA)
    light += (module.OVAL_SIGMA, module.OVAL_SIGMA)
    known, about = [np.eye(6) * 1e-3], [np.zeros(6)]
    for i, rim in enumerate(model.rims):
        size, place, depth = rim.radius_tolerance, rim.place_tolerance, rim.depth_tolerance
        own = np.diag(1.0 / np.array([size, place, place, depth, size]))
        sigma = np.array(light) * (2.0 if rim.kind == "mouth" else 1.0)
        covariance = np.kron(alike, np.diag(sigma**2))
        known += [own, np.linalg.inv(np.linalg.cholesky(covariance))]
        about += [-own @ make[i], np.zeros(LIGHT * views)]
    prior = np.zeros((sum(map(len, known)), A.shape[1]))
    at = 0
    for block in known:
        prior[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    whole = np.concatenate([A * root[:, None], prior])
    x = np.linalg.lstsq(whole, np.concatenate([r * root, *about]), rcond=None)[0]
    every = x[6:].reshape(k, -1)[:, :MAKE]
    covariance = np.linalg.inv(whole.T @ whole)[:6, :6]
    np.testing.assert_allclose(step, x[:6], rtol=1e-6)
    np.testing.assert_allclose(new, make + every, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(np.linalg.inv(information), covariance, rtol=1e-6)

"""The paper's decay, in steps and in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.special import exp1

from armsight.mapping import danger as d
from armsight.mapping.snapshot import VoxelGrid, WorkspaceSnapshot


def test_closed_form_against_an_integrator():
    age = np.linspace(0.0, 24.4, 200)
    u0 = -np.log(d.OCCUPIED)
    # du/dt = -(dC/dt) / C = alpha u exp(u): smooth to integrate
    found = solve_ivp(
        lambda t, u: d.ALPHA * u * np.exp(u), (0, 24.4), [u0], t_eval=age, rtol=1e-10, atol=1e-13
    )
    np.testing.assert_allclose(d.danger(age), np.exp(-found.y[0]), atol=3e-4)


def test_the_papers_decay_time():
    assert d.decay_time() == pytest.approx(24.48, abs=0.005)
    assert d.decay_time(0.3) == pytest.approx(21.10, abs=0.01)
    assert exp1(-np.log(0.999)) == pytest.approx(6.331, abs=0.001)
    # C = 0.5 at 94 % of it
    assert d.danger(np.array([0.94 * d.decay_time()]))[0] == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(
    ("dt", "seconds"), [(0.01, 21.15), (0.5, 23.5), (1.0, 25.0), (0.68, 23.80), (0.72, 24.48)]
)
def test_steps_hang_on_dt(dt, seconds):
    assert d.PaperDecay((1,), dt).steps_to_zero() * dt == pytest.approx(seconds, abs=1e-9)


def test_paper_rule_step_by_step():
    rule = d.PaperDecay((2, 1), dt=0.1)
    rule.update(np.array([[1], [0]]))
    assert rule.danger[:, 0].tolist() == [0.999, 0.0]
    expected = 0.999
    for _ in range(50):
        expected = max(expected + np.log(expected) * 0.03, 0.0)
        rule.update(np.zeros((2, 1)))
        assert rule.danger[0, 0] == pytest.approx(expected, abs=1e-12)
        assert rule.danger[1, 0] == 0.0


@settings(max_examples=20, deadline=None)
@given(st.sampled_from([5, 10, 15, 30, 60, 120]), st.floats(0.1, 0.5))
def test_closed_form_does_not_hang_on_the_rate(rate, alpha):
    """Reading the age at any rate gives the same curve, and the limit of the paper's steps."""
    ages = np.arange(0, d.decay_time(alpha) * 0.9, 1.0 / rate)
    exact = d.danger(ages, alpha)
    fine = d.PaperDecay((1,), dt=0.001, alpha=alpha)
    fine.update(np.ones(1))
    stepped = [0.999]
    for _ in range(len(ages) - 1):
        for _ in range(round(1000 / rate)):
            fine.update(np.zeros(1))
        stepped.append(fine.danger[0])
        if len(stepped) * (1 / rate) > 4:
            break
    np.testing.assert_allclose(stepped, exact[: len(stepped)], atol=2e-3)


def test_borders():
    assert d.danger(np.array([-1.0, 0.0])).tolist() == pytest.approx([0.999, 0.999])
    assert d.danger(np.array([np.inf, 1e9])).tolist() == [0.0, 0.0]
    assert (np.diff(d.danger(np.linspace(0, 30, 3000))) <= 1e-12).all()
    with pytest.raises(ValueError, match="dt"):
        d.PaperDecay((1,), 0.0)


def test_danger_of_a_snapshot():
    grid = VoxelGrid(np.zeros(3), 0.1, (2, 2, 2))
    last = np.full(grid.shape, -np.inf, np.float32)
    last[0, 0, 0], last[1, 1, 1] = 10.0, 4.0
    empty = np.zeros((0, 3), np.float32)
    snapshot = WorkspaceSnapshot(
        sequence=0,
        stamp=10.0,
        oldest=10.0,
        grid=grid,
        state=np.zeros(grid.shape, np.uint8),
        distance=last,
        distance_cap=0.3,
        last_occupied=last,
        hazards=empty,
        hazard_radius=0.1,
        hazard_unknown=np.zeros(0, bool),
        cloud=empty,
        cameras=(),
    )
    points = np.array([[0.05, 0.05, 0.05], [0.15, 0.15, 0.15], [0.05, 0.15, 0.05], [5, 5, 5]])
    got = d.danger_at(snapshot, points, 10.0)
    np.testing.assert_allclose(got, [0.999, d.danger(np.array([6.0]))[0], 0, 0])
    whole = d.danger_grid(snapshot, 10.0)
    assert whole[1, 1, 1] == pytest.approx(got[1], abs=1e-6)
    assert whole.dtype == np.float32

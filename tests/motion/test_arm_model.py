"""The delayed arm predicts exactly what the simulated drives do."""

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.motion.arm_model import DelayedArm
from armsight.simulation.kernels import drive_step


def test_prediction_against_the_simulated_drives():
    rng = np.random.default_rng(0)
    n, delay, dt = 6, 0.06, 0.002
    a, b = np.full(n, 3.0), np.full(n, 5.0)
    arm = DelayedArm(delay, a, b)
    q, v = np.zeros(n), np.zeros(n)
    target, braking = np.zeros(n), True
    queue, predicted = [], {}
    worst = 0.0
    for step in range(2000):
        now = step * dt
        while queue and queue[0][0] <= now + 1e-9:
            _, target, braking = queue.pop(0)
        if step % 4 == 0:
            state = JointState(now, q.copy(), v.copy())
            ahead = arm.ahead(state, now + delay)
            predicted[step + round(delay / dt)] = ahead
            wanted = 0.8 * np.sin(now * np.arange(1, n + 1)) + 0.1 * rng.normal(size=n)
            brake = bool(rng.random() < 0.02)
            arm.sent(now, wanted, brake)
            queue.append((now + delay, wanted, brake))
        if step in predicted and step > 100:
            worst = max(worst, np.abs(predicted[step].position - q).max())
        drive_step(target, braking, q, v, np.full(n, -9.0), np.full(n, 9.0), a, b, dt)
    assert worst < 2e-3


def test_without_commands_the_reading_is_carried_on():
    arm = DelayedArm(0.05, np.ones(1), np.ones(1))
    ahead = arm.ahead(JointState(1.0, np.array([0.5]), np.array([0.2])), 1.1)
    assert ahead.position == pytest.approx([0.52])
    assert arm.ahead(JointState(1.0, np.zeros(1), np.zeros(1)), 0.9).time == 1.0


def test_forget_drops_what_was_on_its_way():
    arm = DelayedArm(0.05, np.full(1, 5.0), np.full(1, 5.0))
    arm.sent(1.0, np.array([1.0]), False)
    reading = JointState(1.0, np.zeros(1), np.zeros(1))
    assert arm.ahead(reading, 1.5).position[0] > 0.1
    arm.forget()
    assert arm.ahead(reading, 1.5).position[0] == 0.0

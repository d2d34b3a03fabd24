"""Whether a camera lies about time: cameras that disagree by more, the faster a target goes.

A camera whose stamps are late shows a target where it was: behind where the others have it by its
speed times the lie. A camera on the arm is besides put where the joints were at another time, so it
is wrong by its own speed, too. One filter over all cameras has the lie of each beside the target
and the biases; only differences can be told, and only while something moves. At rest a lie does no
harm either: there is nothing to be late of.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from armsight.arrays import Floats, Pose, Vector3
from armsight.geometry.pose import inverse
from armsight.servoing.sighting import Look, Sighting

AROUND_IT, WAITS = 0.25, 0.35
"""How fast the target was at a look is told from all looks within so long before and after it; so
long a look waits for those [s]."""
ENOUGH = 6
"""So many looks tell it."""
MOVES, TOLD = 0.05, 12
"""Nothing is said of a camera that saw the target faster than this [m/s] less often than that."""
TURNS_AT = 1.5
"""A target that turns with more than this [m/s^2] is left out: its speed is not told sharply."""
LEAST, SURE = 0.012, 3.5
"""A lie is told from so much on [s], if it is so many standard deviations from none."""
ALIKE = 0.7
"""Who differs from all others by this share of the greatest lie may as well be the liar: of two
cameras nobody knows which."""
PRIOR, WALK = 0.020, 0.0003
"""Standard deviation of a lie before anything was seen [s], and how it changes [s/sqrt(s)]."""
BIAS = 0.012
"""Standard deviation of a camera's place [m]."""
BIAS_WALK = 0.001
"""How a camera's error changes as the target goes elsewhere [m/sqrt(s)]."""
FLOOR = {False: 0.0015, True: 0.003}
"""Least standard deviation of a sighting [m]. The pair's is the greater, though it sees better: its
errors go along with the arm, and one that led the estimate would not be compared with it."""
JERK = 2.0
"""White noise of the target's jerk [m/s^3 / sqrt(Hz)]."""
GATE, AGAIN, GONE = 25.0, 3, 0.7
"""A sighting beyond this chi-square is left out; after so many in turn, or so long without any [s],
the target is looked for anew."""
TURNS = 0.25
"""Two looks of a camera on the arm farther apart say nothing of its speed between them [s]."""
AROUND = 0.15
"""A sighting this far from where the target is believed to be is of something else [m]."""


class ClockWatch:
    """Compares the stamps of all cameras that see one target.

    Args:
        cameras: their names.

    Attributes:
        words: who lies about time, newest; empty while nobody is known to.
    """

    def __init__(self, cameras: Sequence[str]) -> None:
        self._cameras = tuple(cameras)
        self._n = 9 + 4 * len(self._cameras)
        self.reset()

    def reset(self) -> None:
        """Nothing has been seen."""
        self.words = ""
        self._waiting: list[tuple[Look, Sighting]] = []
        self._around: deque[tuple[float, Vector3]] = deque(maxlen=64)
        self._mean = np.zeros(self._n)
        self._P = np.zeros((self._n, self._n))
        self._stamp = -math.inf
        self._missed = 0
        self._seen = np.zeros(len(self._cameras), int)
        self._wrist: deque[tuple[float, Pose]] = deque(maxlen=16)
        lies, first = self._lies, 9
        for i in range(len(self._cameras)):
            self._P[lies + i, lies + i] = PRIOR**2
            self._P[first + 3 * i : first + 3 * i + 3, first + 3 * i : first + 3 * i + 3] = (
                np.eye(3) * BIAS**2
            )

    @property
    def _lies(self) -> int:
        return 9 + 3 * len(self._cameras)

    def see(self, look: Look, place: Vector3) -> None:
        """One camera looked.

        Args:
            look: what it saw.
            place: (3,) where the target is believed to be [m].
        """
        if look.camera not in self._cameras:
            return
        if look.wrist:
            self._wrist.append((look.stamp, look.T_base_camera))
        near = [s for s in look.sightings if np.linalg.norm(s.position - place) < AROUND]
        if near:
            best = min(near, key=lambda s: float(np.linalg.norm(s.position - place)))
            self._waiting.append((look, best))
            bias = 9 + 3 * self._cameras.index(look.camera)
            self._around.append((look.stamp, best.position - self._mean[bias : bias + 3]))
        self._waiting.sort(key=lambda one: one[0].stamp)
        while self._waiting and self._waiting[0][0].stamp < look.stamp - WAITS:
            self._take(*self._waiting.pop(0))
            self.words = self.fault()

    def lies(self) -> dict[str, tuple[float, float]]:
        """By how much the stamps of each camera are later than the others', and its deviation [s].

        Empty before two have seen the target move.
        """
        known = np.flatnonzero(self._seen >= TOLD)
        if len(known) < 2:
            return {}
        start, out = self._lies, {}
        for i in known:
            row = np.zeros(self._n)
            row[start + known] = -1.0 / (len(known) - 1)
            row[start + i] = 1.0
            sigma = math.sqrt(max(float(row @ self._P @ row), 0.0))
            out[self._cameras[i]] = (float(row @ self._mean), sigma)
        return out

    def fault(self) -> str:
        """Who lies about time, in words; empty while nobody is known to."""
        found = self.lies()
        sure = {
            name: late
            for name, (late, sigma) in found.items()
            if abs(late) > LEAST and abs(late) > SURE * sigma
        }
        if not sure:
            return ""
        most = max(abs(late) for late in sure.values())
        names = [name for name, late in sure.items() if abs(late) >= ALIKE * most]
        late = sure[names[0]]
        way = "late" if late > 0.0 else "early"
        return (
            f"{' or '.join(names)}: stamps about {1e3 * abs(late):.0f} ms {way} against the other "
            "cameras; check its clock"
        )

    def _take(self, look: Look, sighting: Sighting) -> None:
        """One sighting in the order of its stamp."""
        i = self._cameras.index(look.camera)
        own = np.zeros(3)
        if look.wrist:
            twist = self._carried(look.stamp, sighting.position)
            if twist is None:
                return
            own = twist
        R = sighting.covariance + FLOOR[look.wrist] ** 2 * np.eye(3)
        velocity = self._velocity(look.stamp)
        if velocity is None:
            self._missed = AGAIN
            return
        dt = look.stamp - self._stamp
        if not dt < GONE or self._missed >= AGAIN:
            self._begin(sighting.position, i)
            self._stamp = look.stamp
            return
        self._carry(max(dt, 0.0))
        self._stamp = max(self._stamp, look.stamp)
        lie, bias = self._lies + i, 9 + 3 * i
        speed = velocity - own
        H = np.zeros((3, self._n))
        H[:, :3] = np.eye(3)
        H[:, bias : bias + 3] = np.eye(3)
        H[:, lie] = -speed
        expected = self._mean[:3] + self._mean[bias : bias + 3] - self._mean[lie] * speed
        innovation = sighting.position - expected
        PH = self._P @ H.T
        S = H @ PH + R
        if float(innovation @ np.linalg.solve(S, innovation)) > GATE:
            self._missed += 1
            return
        self._missed = 0
        self._seen[i] += float(np.linalg.norm(speed)) > MOVES
        K = np.linalg.solve(S, PH.T).T
        self._mean = self._mean + K @ innovation
        P = self._P - K @ PH.T
        self._P = 0.5 * (P + P.T)

    def _begin(self, place: Vector3, i: int) -> None:
        """The target is looked for anew; what is known of the cameras stays."""
        bias = slice(9 + 3 * i, 12 + 3 * i)
        self._mean[:3] = place - self._mean[bias]
        self._mean[3:9] = 0.0
        self._P[:9] = 0.0
        self._P[:, :9] = 0.0
        self._P[:9, :9] = np.diag(np.repeat([0.03, 0.5, 1.0], 3) ** 2)
        self._missed = 0

    def _carry(self, dt: float) -> None:
        """The state a time [s] later."""
        if dt <= 0.0:
            return
        F = np.eye(self._n)
        F[:3, 3:6] = F[3:6, 6:9] = dt * np.eye(3)
        F[:3, 6:9] = 0.5 * dt * dt * np.eye(3)
        F[6:9, 6:9] = math.exp(-dt) * np.eye(3)
        Q = np.zeros((self._n, self._n))
        j = JERK**2
        for a, b, value in (
            (0, 0, dt**5 / 20.0), (0, 3, dt**4 / 8.0), (3, 3, dt**3 / 3.0),
            (0, 6, dt**3 / 6.0), (3, 6, dt**2 / 2.0), (6, 6, dt),
        ):  # fmt: skip
            Q[a : a + 3, b : b + 3] = Q[b : b + 3, a : a + 3] = j * value * np.eye(3)
        biases = slice(9, self._lies)
        Q[biases, biases] = BIAS_WALK**2 * dt * np.eye(self._lies - 9)
        Q[self._lies :, self._lies :] = WALK**2 * dt * np.eye(len(self._cameras))
        self._mean = F @ self._mean
        self._P = F @ self._P @ F.T + Q

    def _velocity(self, stamp: float) -> Vector3 | None:
        """(3,) of the target at a time [m/s], by the looks around it; None if few, or it turns."""
        near = [(at - stamp, p) for at, p in self._around if abs(at - stamp) < AROUND_IT]
        if sum(at > 0.0 for at, _ in near) < ENOUGH // 2 or len(near) < ENOUGH:
            return None
        t = np.array([at for at, _ in near])
        A = np.stack([np.ones_like(t), t, t * t], axis=1)
        fit, *_ = np.linalg.lstsq(A, np.array([p for _, p in near]), rcond=None)
        turns = 2.0 * float(np.linalg.norm(fit[2]))
        return None if turns > TURNS_AT else np.asarray(fit[1])

    def _carried(self, stamp: float, point: Vector3) -> Vector3 | None:
        """(3,) velocity of a point that goes along with the camera on the arm [m/s]; or None."""
        before = [one for one in self._wrist if one[0] < stamp]
        after = [one for one in self._wrist if one[0] > stamp]
        if not before or not after:
            return None
        (early, T_early), (late, T_late) = before[-1], after[0]
        now = next((T for at, T in self._wrist if at == stamp), None)
        if now is None or late - early > TURNS:
            return None
        p: Floats = inverse(now) @ np.array([*point, 1.0])
        return np.asarray(((T_late @ p)[:3] - (T_early @ p)[:3]) / (late - early))

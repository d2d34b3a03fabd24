"""Where the target is and how it moves: one filter over all sensors, each with a bias of its own.

V found averaging all sensors worse than choosing, because its 2-5 cm of registration error were in
no model. Here each camera has a bias, a slow random walk with a prior; differences of biases show
as soon as two cameras see the target, and the pair's own shows in the mark on the tool, whose place
the joints tell. So nothing jumps when a sensor comes or goes. What a camera errs by because a part
of the target is hidden is a bias, too: as random error it would make the filter slow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from armsight.arrays import Floats, Vector3
from armsight.servoing.sighting import Look, Sighting

NEWS, SHARP = 0.3, 0.02
"""Share of a new normal in the one that is believed, of one that is known so well [rad] or better;
of others less."""


@dataclass(frozen=True)
class FilterConfig:
    """Settings of :class:`TargetFilter`.

    Attributes:
        acceleration: white noise of the target's acceleration [m/s^2 / sqrt(Hz)] in each of the
            modes: at rest, on its way, and when it does what nobody expected.
        damping: a velocity forgets itself within this time [s], in each mode.
        turn: an acceleration that goes on, as on a curve, forgets itself within this time [s].
        jerk: white noise that drives it, in each mode [m/s^3 / sqrt(Hz)].
        stay: a mode lasts this long on average [s].
        horizon: in a prediction a velocity dies away within this time [s]; people's hands do. At
            0.2 s, and on 60 recorded hands, 0.5 s err by 80 mm and no decay by 83; but 0.7 s would
            feed a quarter too little of a velocity that lasts forward: 10 mm behind a circle.
        curve: so does an acceleration [s].
        bias_fixed, bias_wrist: prior of a camera's bias [m]; bias_walk: its walk [m/sqrt(s)].
        floor_fixed, floor_wrist: least standard deviation of a sighting [m].
        lasts: an error that a camera's sightings share changes within this time [s].
        mark: how far the pair's error at the target may differ from that at the tool's mark [m].
        gate: chi-square with 3 degrees of freedom above which a sighting is not believed.
        again: so many unbelieved sightings that agree within ``agree`` [m] begin the estimate anew.
        memory: how late a measurement may come [s].
        biases: whether cameras have biases at all (an ablation).
    """

    acceleration: tuple[float, ...] = (0.03, 0.05, 2.0)
    damping: tuple[float, ...] = (0.15, 20.0, 20.0)
    turn: float = 1.0
    jerk: tuple[float, ...] = (0.0, 0.8, 3.0)
    stay: float = 1.0
    horizon: float = 2.0
    curve: float = 0.175
    bias_fixed: float = 0.012
    bias_wrist: float = 0.004
    bias_walk: float = 0.001
    floor_fixed: float = 0.0015
    floor_wrist: float = 0.0004
    lasts: float = 10.0
    mark: float = 0.0015
    gate: float = 16.3
    again: int = 3
    agree: float = 0.1
    memory: float = 0.5
    biases: bool = True


@dataclass(frozen=True)
class TargetEstimate:
    """The target at one instant.

    Attributes:
        stamp: of the estimate, the newest exposure that went in [s].
        position: (3,) in ``base`` [m]; velocity: (3,) [m/s]; acceleration: (3,)
            [m/s^2].
        covariance: (6, 6) of position and velocity.
        horizon, curve: see :class:`FilterConfig`.
        modes: how likely each mode is.
        seen: newest exposure that showed the target [s]; the stamp may be that of the tool's mark.
        wrist_stamp: newest exposure of the pair that showed it [s]; -inf for never.
        normal: (3,) of a target with a face, or None.
        along: (3,) unit, where it goes on beyond its point, or None.
    """

    stamp: float
    position: Vector3
    velocity: Vector3
    acceleration: Vector3
    covariance: Floats
    horizon: float
    curve: float
    modes: Floats
    seen: float = -math.inf
    wrist_stamp: float = -math.inf
    normal: Vector3 | None = None
    along: Vector3 | None = None

    def at(self, time: float) -> tuple[Vector3, Vector3]:
        """Predicted position [m] and velocity [m/s] at a time [s]; what drives it dies away."""
        ahead = max(time - self.stamp, 0.0)
        left = math.exp(-ahead / self.horizon)
        way = self.horizon * (1.0 - left)
        short = self.curve
        speed = short * (1.0 - math.exp(-ahead / short))
        return (
            self.position + self.velocity * way + self.acceleration * short * (ahead - speed),
            self.velocity * left + self.acceleration * speed,
        )

    def sigma(self, time: float) -> float:
        """Standard deviation of the predicted position along its worst axis [m]."""
        h = max(time - self.stamp, 0.0)
        F = np.concatenate([np.eye(3), h * np.eye(3)], axis=1)
        return float(np.sqrt(np.linalg.eigvalsh(F @ self.covariance @ F.T)[-1]))


@dataclass
class _Event:
    """One measurement and the state after it: of each mode, their shares, and all together.

    By ``loose`` [m^2] its camera's bias may have changed since the last one.
    """

    stamp: float
    camera: str
    z: Vector3
    R: Floats
    of_mark: bool = False
    wrist: bool = False
    loose: float = 0.0
    means: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    Ps: Floats = field(default_factory=lambda: np.zeros((0, 0, 0)))
    modes: Floats = field(default_factory=lambda: np.zeros(0))
    mean: Floats = field(default_factory=lambda: np.zeros(0))
    P: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    believed: bool = True

    def set(self, means: Floats, Ps: Floats, modes: Floats) -> None:
        """The state after it."""
        self.means, self.Ps, self.modes = means, Ps, modes
        self.mean, self.P = _together(means, Ps, modes)


def _together(means: Floats, Ps: Floats, shares: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance of a mixture."""
    mean = shares @ means
    off = means - mean
    return mean, np.einsum("k,kij->ij", shares, Ps + off[:, :, None] * off[:, None, :])


def _turned(old: Vector3 | None, new: Vector3, share: float) -> Vector3:
    """(3,) unit: a share of the way from an old direction to a new one; the new one without one."""
    mixed = new if old is None else old + share * (new - old)
    return np.asarray(mixed / max(float(np.linalg.norm(mixed)), 1e-9))


class TargetFilter:
    """Fuses sightings by the time of their exposure, however late they come.

    Interacting multiple models (Blom and Bar-Shalom 1988): a Kalman filter in each mode, mixed.

    Args:
        cameras: names of all that may see the target; wrist: which of them is on the arm.
        config: settings.
    """

    def __init__(
        self, cameras: Sequence[str], wrist: str = "", config: FilterConfig | None = None
    ) -> None:
        self.config = config or FilterConfig()
        self._index = {name: 9 + 3 * i for i, name in enumerate(cameras)}
        self._wrist = wrist
        self._n = 9 + 3 * len(self._index)
        self.reset()

    def reset(self) -> None:
        """Nothing has been seen, and nothing learned of the cameras: a run begins anew."""
        self._bias, self._bias_P = self._prior()
        self._forget_target()

    def _forget_target(self) -> None:
        """Nothing has been seen; what was learned of the cameras stays."""
        self._events: list[_Event] = []
        self._base: _Event | None = None
        self._refused: list[tuple[float, Vector3, str]] = []
        self._wrist_stamp = self._seen = -math.inf
        self._normal: Vector3 | None = None
        self._along: Vector3 | None = None
        self._lasting: dict[str, tuple[float, float]] = {}
        self.restarts = 0

    @property
    def estimate(self) -> TargetEstimate | None:
        """The newest estimate, or None before the first sighting."""
        last = self._events[-1] if self._events else self._base
        if last is None:
            return None
        return TargetEstimate(
            last.stamp,
            last.mean[:3].copy(),
            last.mean[3:6].copy(),
            last.mean[6:9].copy(),
            last.P[:6, :6].copy(),
            self.config.horizon,
            self.config.curve,
            last.modes.copy(),
            self._seen,
            self._wrist_stamp,
            self._normal,
            self._along,
        )

    def bias(self, camera: str) -> Vector3:
        """(3,) what a camera's place is believed to be off by [m]."""
        last = self._events[-1] if self._events else self._base
        i = self._index[camera]
        mean = self._bias if last is None else last.mean
        return np.asarray(mean[i : i + 3].copy())

    def add(self, look: Look) -> bool:
        """Take in what one camera saw; whether any of it was believed."""
        if look.camera not in self._index or not math.isfinite(look.stamp):
            return False
        if self._base is not None and look.stamp < self._base.stamp:
            return False  # what comes too late contradicts nothing
        chosen = self._choose(look.sightings, look.stamp)
        loose, apart = self._loosened(look, chosen)
        if look.mark is not None and self.config.biases:
            R = look.mark_covariance + (self.config.mark**2 + apart) * np.eye(3)
            self._measure(_Event(look.stamp, look.camera, look.mark, R, True, look.wrist, loose))
            loose = 0.0
        if chosen is None:
            return False
        floor = self.config.floor_wrist if look.wrist else self.config.floor_fixed
        R = chosen.covariance + floor**2 * np.eye(3)
        if not self.config.biases:
            R, loose = R + chosen.lasting**2 * np.eye(3), 0.0
        event = _Event(look.stamp, look.camera, chosen.position, R, False, look.wrist, loose)
        believed = self._measure(event)
        if believed:
            self._refused.clear()
            self._seen = max(self._seen, look.stamp)
            if look.wrist:
                self._wrist_stamp = max(self._wrist_stamp, look.stamp)
            if chosen.normal is not None:
                share = NEWS * min(1.0, SHARP / max(chosen.tilt, 1e-6))
                self._normal = _turned(self._normal, chosen.normal, share)
            if chosen.along is not None:
                self._along = _turned(self._along, chosen.along, NEWS)
            return True
        return self._doubt(event)

    def _loosened(self, look: Look, chosen: Sighting | None) -> tuple[float, float]:
        """Variances [m^2] of what a camera's sightings err by together, since its last look.

        By the first its bias may have changed; the second is what its bias may differ by from what
        the mark says: in full where something else is hidden now, else no news, of which as much is
        told as keeps the bias's own variance at that of what lasts.
        """
        stamp, before = self._lasting.get(look.camera, (look.stamp, 0.0))
        lasting = before if chosen is None else chosen.lasting
        self._lasting[look.camera] = look.stamp, lasting
        if lasting != before:
            return before**2 + lasting**2, lasting**2
        share = float(np.clip(2.0 * (look.stamp - stamp) / self.config.lasts, 1e-3, 1.0))
        return share * lasting**2, lasting**2 / share

    def _choose(self, sightings: Sequence[Sighting], stamp: float) -> Sighting | None:
        """Of several that look alike the one that is where it is expected; else the best."""
        if not sightings:
            return None
        known = self.estimate
        if known is None or len(sightings) == 1 or stamp - known.stamp > 1.0:
            return sightings[0]
        expected, _ = known.at(stamp)
        return min(sightings, key=lambda s: float(np.linalg.norm(s.position - expected)))

    def _doubt(self, event: _Event) -> bool:
        """Several refused sightings that agree with each other are the target after all."""
        position = event.z - self._bias_of(event)
        self._refused = [r for r in self._refused if r[0] > event.stamp - 1.0]
        self._refused.append((event.stamp, position, event.camera))
        near = [r for r in self._refused if np.linalg.norm(r[1] - position) < self.config.agree]
        if len(near) < self.config.again:
            return False
        last = self._events[-1] if self._events else self._base
        if last is not None:
            self._bias, self._bias_P = last.mean[9:], last.P[9:, 9:]
            self._bias = np.concatenate([np.zeros(9), self._bias])
        restarts = self.restarts + 1
        wrist = self._wrist_stamp
        self._forget_target()
        self.restarts, self._wrist_stamp, self._seen = restarts, wrist, event.stamp
        return self._measure(event)

    def _bias_of(self, event: _Event) -> Vector3:
        return self.bias(event.camera)

    def _prior(self) -> tuple[Floats, Floats]:
        c = self.config
        mean = np.zeros(self._n)
        P = np.zeros((self._n - 9, self._n - 9))
        for name, i in self._index.items():
            sigma = c.bias_wrist if name == self._wrist else c.bias_fixed
            P[i - 9 : i - 6, i - 9 : i - 6] = np.eye(3) * (sigma if c.biases else 1e-6) ** 2
        return mean, P

    def _measure(self, event: _Event) -> bool:
        """Insert a measurement by its stamp and run forward again from there."""
        if self._base is None:
            if event.of_mark:
                return False
            self._begin(event)
            return True
        if event.stamp < self._base.stamp:
            return False  # too late: what came before has been forgotten
        at = len(self._events)
        while at > 0 and self._events[at - 1].stamp > event.stamp:
            at -= 1
        self._events.insert(at, event)
        for i in range(at, len(self._events)):
            self._apply(self._events[i], self._events[i - 1] if i > 0 else self._base)
        self._forget()
        return event.believed

    def _begin(self, event: _Event) -> None:
        """The first sighting."""
        mean = self._bias.copy()
        i = self._index[event.camera]
        mean[:3] = event.z - mean[i : i + 3]
        mean[3:9] = 0.0
        P = np.zeros((self._n, self._n))
        P[9:, 9:] = self._bias_P
        P[i : i + 3, i : i + 3] += event.loose * np.eye(3)
        own = P[i : i + 3, 9:].copy()
        P[:3, :3] = event.R + own[:, i - 9 : i - 6]
        P[:3, 9:], P[9:, :3] = -own, -own.T
        P[3:6, 3:6] = 0.5**2 * np.eye(3)
        count = len(self.config.acceleration)
        event.set(np.tile(mean, (count, 1)), np.tile(P, (count, 1, 1)), np.full(count, 1 / count))
        self._base = event
        if event.wrist:
            self._wrist_stamp = max(self._wrist_stamp, event.stamp)

    def _apply(self, event: _Event, before: _Event) -> None:
        """State after a measurement, from the state after the one before it."""
        c, dt = self.config, max(event.stamp - before.stamp, 0.0)
        H = np.zeros((3, self._n))
        i = self._index[event.camera]
        H[:, i : i + 3] = np.eye(3)
        if not event.of_mark:
            H[:, :3] = np.eye(3)
        starts, start_Ps, shares = self._mixed(before, dt)
        means, Ps = np.empty_like(before.means), np.empty_like(before.Ps)
        seen_means, seen_Ps = np.empty_like(means), np.empty_like(Ps)
        likely, square = np.empty(len(shares)), math.inf
        for k in range(len(shares)):
            means[k], Ps[k] = self._carry(starts[k], start_Ps[k], dt, k)
            Ps[k, i : i + 3, i : i + 3] += event.loose * np.eye(3)
            innovation = event.z - H @ means[k]
            PH = Ps[k] @ H.T
            S = H @ PH + event.R
            S_inv = np.linalg.inv(S)
            chi = float(innovation @ S_inv @ innovation)
            square = min(square, chi)
            likely[k] = -0.5 * (chi + math.log(np.linalg.det(S)))
            K = PH @ S_inv
            seen_means[k] = means[k] + K @ innovation
            P = Ps[k] - K @ PH.T
            seen_Ps[k] = 0.5 * (P + P.T)
        event.believed = square <= c.gate
        if event.believed:
            modes = shares * np.exp(likely - likely.max())
            event.set(seen_means, seen_Ps, modes / modes.sum())
        else:  # a speck says nothing of how the target moves
            event.set(means, Ps, shares)

    def _mixed(self, before: _Event, dt: float) -> tuple[Floats, Floats, Floats]:
        """Where each mode begins, if the target may have changed from any to any other."""
        count = len(before.modes)
        if count == 1 or dt <= 0.0:
            return before.means, before.Ps, before.modes
        stay = math.exp(-dt / self.config.stay)
        change = np.full((count, count), (1.0 - stay) / (count - 1))
        np.fill_diagonal(change, stay)
        joint = change * before.modes[:, None]
        shares = joint.sum(axis=0)
        starts = [_together(before.means, before.Ps, joint[:, k] / shares[k]) for k in range(count)]
        return np.array([m for m, _ in starts]), np.array([P for _, P in starts]), shares

    def _carry(self, mean: Floats, P: Floats, dt: float, mode: int) -> tuple[Floats, Floats]:
        """The state of a mode a time [s] later."""
        if dt <= 0.0:
            return mean, P
        c = self.config
        damping, q = c.damping[mode], c.acceleration[mode] ** 2
        left = math.exp(-dt / damping)
        F = np.eye(self._n)
        F[:3, 3:6] = damping * (1.0 - left) * np.eye(3)
        F[3:6, 3:6] = left * np.eye(3)
        F[:3, 6:9] = 0.5 * dt * dt * np.eye(3)
        F[3:6, 6:9] = dt * np.eye(3)
        j = c.jerk[mode] ** 2
        F[6:9, 6:9] = (math.exp(-dt / c.turn) if j > 0.0 else 0.0) * np.eye(3)
        # White noise of acceleration and of jerk through the chain of integrators.
        terms = (
            (0, 0, q * dt**3 / 3.0 + j * dt**5 / 20.0),
            (0, 3, q * dt**2 / 2.0 + j * dt**4 / 8.0),
            (3, 3, q * dt + j * dt**3 / 3.0),
            (0, 6, j * dt**3 / 6.0),
            (3, 6, j * dt**2 / 2.0),
            (6, 6, j * dt),
        )
        Q = np.zeros((self._n, self._n))
        for a, b, value in terms:
            Q[a : a + 3, b : b + 3] = Q[b : b + 3, a : a + 3] = value * np.eye(3)
        if c.biases:
            Q[9:, 9:] = c.bias_walk**2 * dt * np.eye(self._n - 9)
        return F @ mean, F @ P @ F.T + Q

    def _forget(self) -> None:
        """Measurements older than the memory become the base."""
        oldest = self._events[-1].stamp - self.config.memory
        while len(self._events) > 1 and self._events[0].stamp < oldest:
            self._base = self._events.pop(0)

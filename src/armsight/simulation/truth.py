"""What really happened, for experiments only: contacts, distances, speeds. No device knows it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from armsight.arrays import Floats, Ints, Vector3
from armsight.robots.robot import Robot
from armsight.simulation.gl import mujoco
from armsight.simulation.kernels import gap_bounds
from armsight.simulation.model import CellModel
from armsight.simulation.model_parts import TOUCH_ONLY, Part

MOVING = 0.05
"""The arm moves when the touching point is faster than this [m/s]."""
APART = 0.05
"""A contact is over when the two have been apart for this long [s]."""
FAR = 3.0
"""Distances beyond this are not measured [m]."""
KEPT = 20_000
"""Measurements that are remembered."""


@dataclass
class Contact:
    """The arm, or its tool, touched something.

    Attributes:
        kind: person, object, static, undeclared or floor.
        owner: whom or what; part: of a person's body.
        link: index of the arm's link.
        start, end: first and last touch [s].
        depth: greatest penetration [m].
        arm_speed: greatest speed of the arm at the touching point while touching [m/s].
        position: of the first touch in world [m].
        region: of a person's body, as in :data:`~armsight.geometry.body_regions.BODY_REGIONS`.
        force: greatest force between the two [N], NaN where contact is noticed but pushes nobody.
        impulse: sum of that force over the time of contact [N s].
    """

    kind: str
    owner: str
    part: str
    link: int
    start: float
    end: float
    depth: float
    arm_speed: float
    position: Vector3
    region: str = ""
    force: float = float("nan")
    impulse: float = 0.0

    @property
    def moving(self) -> bool:
        """Whether the arm moved while touching: such a contact counts."""
        return self.arm_speed > MOVING


@dataclass(frozen=True)
class Separation:
    """The arm and the nearest person at one instant.

    Attributes:
        time: [s]; distance: [m], ``inf`` when nobody is within :data:`FAR`, negative in contact.
        owner, part: nearest person and body part; link: nearest link of the arm.
        arm_speed: of the arm's nearest point [m/s].
        tip_speed: of the tip [m/s].
    """

    time: float
    distance: float
    owner: str
    part: str
    link: int
    arm_speed: float
    tip_speed: float


class Truth:
    """Collects what happens.

    Attributes:
        contacts: of the arm since the last reset.
        separations: of the last :data:`KEPT` measurements; a cell may run for days.
        min_distance: least distance of the arm to a person so far [m]; ``inf`` with nobody near.
        min_moving_distance: the same while the arm moved faster than :data:`MOVING`.
    """

    def __init__(self, cell: CellModel, robot: Robot, data: Any) -> None:
        self._cell = cell
        self._data = data
        self._n = robot.n
        tip = np.eye(4) if robot.tool is None else robot.tool.T_flange_tcp
        self._T_last_tip = robot.T_last_flange @ tip
        contact = [i for i, part in enumerate(cell.parts) if part.kind == "arm"]
        touching = cell.model.geom_contype
        self._arm: Ints = np.array([i for i in contact if touching[i]], int)
        people = [i for i, part in enumerate(cell.parts) if part.kind == "person"]
        self._people: Ints = np.array([i for i in people if touching[i]], int)
        self._radii = np.array([bounding_radius(cell.model, geom) for geom in self._arm])
        axes = [bounding_capsule(cell.model, geom) for geom in self._people]
        self._half_axis = np.array([axis for axis, _ in axes]).reshape(-1, 3)
        self._widths = np.array([width for _, width in axes])
        self._bound = np.zeros((len(self._arm), len(self._people)))
        self._jacobian = np.zeros((3, cell.model.nv))
        self._turning = np.zeros((3, cell.model.nv))
        self._pushes = np.asarray(cell.model.geom_priority) != TOUCH_ONLY["priority"]
        self._by_arm = np.array([part.kind == "arm" for part in cell.parts], bool)
        self._link: Ints = np.array([part.link for part in cell.parts], int)
        names = [(part.owner, part.part) for part in cell.parts]
        self._whom: Ints = np.array([names.index(name) for name in names], int)
        self._fromto = np.zeros(6)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.contacts: list[Contact] = []
        self.separations: deque[Separation] = deque(maxlen=KEPT)
        self.min_distance = self.min_moving_distance = float("inf")
        self._open: dict[tuple[int, str, str], Contact] = {}
        self._last_pair = (0, 0)

    @property
    def moving_contacts(self) -> list[Contact]:
        """Contacts that count: the arm moved faster than :data:`MOVING`."""
        return [contact for contact in self.contacts if contact.moving]

    def tip_position(self) -> Vector3:
        """(3,) true position of the tip in world [m]."""
        body = self._cell.link_bodies[-1]
        R = self._data.xmat[body].reshape(3, 3)
        return np.asarray(R @ self._T_last_tip[:3, 3] + self._data.xpos[body])

    def link_poses(self) -> Floats:
        """(n + 1, 4, 4) true poses of the links in world."""
        poses = np.tile(np.eye(4), (self._n + 1, 1, 1))
        poses[:, :3, :3] = self._data.xmat[self._cell.link_bodies].reshape(-1, 3, 3)
        poses[:, :3, 3] = self._data.xpos[self._cell.link_bodies]
        return poses

    def note_contacts(self, now: float, seconds: float) -> None:
        """Look at the contacts of the step of some seconds [s] that began at ``now`` [s].

        All at once: a plug in its socket touches it in fifty points, a thousand times a second.
        """
        contact = self._data.contact
        geoms, by_arm = contact.geom, self._by_arm[contact.geom]
        of_arm = np.flatnonzero((contact.dist <= 0.0) & (by_arm[:, 0] != by_arm[:, 1]))
        if not len(of_arm):
            return
        first = by_arm[of_arm, 0]
        here = np.where(first, geoms[of_arm, 0], geoms[of_arm, 1])
        there = np.where(first, geoms[of_arm, 1], geoms[of_arm, 0])
        gaps, points = contact.dist[of_arm], contact.pos[of_arm]
        pairs = np.stack([self._link[here], self._whom[there]], axis=1)
        for link, whom in dict.fromkeys(map(tuple, pairs.tolist())):
            touch = np.flatnonzero((pairs[:, 0] == link) & (pairs[:, 1] == whom))
            arm, other = self._cell.parts[here[touch[0]]], self._cell.parts[there[touch[0]]]
            gap, point = float(gaps[touch].min()), points[touch[0]]
            speed = self._fastest(int(self._cell.link_bodies[link]), points[touch])
            found = self._note(arm, other, int(there[touch[0]]), now, gap, point, speed)
            pushing = touch[self._pushes[here[touch]] & self._pushes[there[touch]]]
            if len(pushing):
                sign = np.where(first[pushing], 1.0, -1.0)
                strength = self._push(of_arm[pushing], sign)
                found.force = max(strength, 0.0 if np.isnan(found.force) else found.force)
                found.impulse += strength * seconds

    def _push(self, which: Ints, sign: Floats) -> float:
        """Strength of the sum of some contacts' forces, each with its sign [N]."""
        forces = np.empty((len(which), 6))
        for row, i in zip(forces, which.tolist()):
            mujoco.mj_contactForce(self._cell.model, self._data, i, row)
        frames = self._data.contact.frame[which].reshape(-1, 3, 3)
        return float(np.linalg.norm(np.einsum("k,kij,ki->j", sign, frames, forces[:, :3])))

    def _fastest(self, body: int, points: Floats) -> float:
        """Speed of the fastest of some points (k, 3) of a body of the arm [m/s]."""
        place, velocity = self._data.xpos[body], self._data.qvel
        mujoco.mj_jac(self._cell.model, self._data, self._jacobian, self._turning, place, body)
        x, y, z = (points - place).T
        a, b, c = (self._turning @ velocity).tolist()
        u, v, w = (self._jacobian @ velocity).tolist()
        squares = (u + b * z - c * y) ** 2 + (v + c * x - a * z) ** 2 + (w + a * y - b * x) ** 2
        return math.sqrt(squares.max())

    def note_separation(self, now: float) -> None:
        """Measure the distance from the arm to the nearest person."""
        tip_body = int(self._cell.link_bodies[-1])
        tip_speed = self._speed(tip_body, self.tip_position())
        found = self._nearest()
        if found is None:
            if len(self._people):
                nobody = Separation(now, float("inf"), "", "", -1, 0.0, tip_speed)
                self.separations.append(nobody)
            return
        distance, arm_geom, person_geom, point = found
        arm, person = self._cell.parts[arm_geom], self._cell.parts[person_geom]
        speed = self._speed(int(self._cell.link_bodies[arm.link]), point)
        self.separations.append(
            Separation(now, distance, person.owner, person.part, arm.link, speed, tip_speed)
        )
        self.min_distance = min(self.min_distance, distance)
        if max(speed, tip_speed) > MOVING:
            self.min_moving_distance = min(self.min_moving_distance, distance)

    def _note(
        self,
        arm: Part,
        other: Part,
        geom: int,
        now: float,
        gap: float,
        point: Vector3,
        speed: float,
    ) -> Contact:
        key = (arm.link, other.owner, other.part)
        known = self._open.get(key)
        if known is None or now - known.end > APART:
            region = ""
            if other.kind == "person":
                body = int(self._cell.model.geom_bodyid[geom])
                R = self._data.xmat[body].reshape(3, 3)
                region = region_at(other.part, R.T @ (point - self._data.xpos[body]))
            known = Contact(
                other.kind, other.owner, other.part, arm.link, now, now, -gap, speed, point, region
            )
            self._open[key] = known
            self.contacts.append(known)
            return known
        known.end = now
        known.depth = max(known.depth, -gap)
        known.arm_speed = max(known.arm_speed, speed)
        return known

    def _nearest(self) -> tuple[float, int, int, Vector3] | None:
        """Least distance between the arm's and people's shapes.

        The pair that was nearest before is measured first: bounds then rule out most others.
        """
        if not len(self._people):
            return None
        d, bound = self._data, self._bound
        center = d.geom_xpos[self._people]
        turned = d.geom_xmat[self._people].reshape(-1, 3, 3)
        half = np.einsum("kij,kj->ki", turned, self._half_axis)
        gap_bounds(
            d.geom_xpos[self._arm], self._radii, center - half, center + half, self._widths, bound
        )
        best, pair, point = FAR, (-1, -1), np.zeros(3)
        first = self._last_pair
        candidates = [first] if bound[first] < best else []
        for i, j in candidates:
            best, pair, point = self._closer(i, j, best, pair, point)
        rows, columns = np.nonzero(bound < best)
        order = np.argsort(bound[rows, columns], kind="stable")
        for i, j in zip(rows[order].tolist(), columns[order].tolist()):
            if bound[i, j] >= best:
                break
            if (i, j) != first:
                best, pair, point = self._closer(i, j, best, pair, point)
        if pair[0] < 0:
            return None
        self._last_pair = pair
        return best, int(self._arm[pair[0]]), int(self._people[pair[1]]), point

    def _closer(
        self, i: int, j: int, best: float, pair: tuple[int, int], point: Vector3
    ) -> tuple[float, tuple[int, int], Vector3]:
        """The nearer of a pair of shapes and the best so far: distance, pair, point of the arm."""
        a, b = int(self._arm[i]), int(self._people[j])
        distance = float(
            mujoco.mj_geomDistance(self._cell.model, self._data, a, b, best, self._fromto)
        )
        if distance < best:
            return distance, (i, j), self._fromto[:3].copy()
        return best, pair, point

    def _speed(self, body: int, point: Vector3) -> float:
        """Speed of a point of the arm [m/s]."""
        mujoco.mj_jac(self._cell.model, self._data, self._jacobian, None, point, body)
        return float(np.linalg.norm(self._jacobian @ self._data.qvel))


LIMBS = {
    "upper_arm": "upper_arm",
    "forearm": "lower_arm",
    "hand": "hand",
    "thigh": "thigh",
    "shin": "lower_leg",
    "foot": "lower_leg",
}


def region_at(part: str, point: Vector3) -> str:
    """Region of the body at a point in a part's frame [m]; x is forward, z from joint to joint."""
    forward = point[0] > 0.02
    if part == "head":
        return "neck" if point[2] < 0.06 else "face" if forward else "skull"
    if part == "torso":
        if point[2] < 0.1:
            return "pelvis"
        return "back" if point[0] < 0.0 else "abdomen" if point[2] < 0.3 else "chest"
    return LIMBS[part.split("_", 1)[1]]


def bounding_radius(model: Any, geom: int) -> float:
    """Radius of the sphere about a geom's centre that contains it [m]."""
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
        return float(model.geom_rbound[geom])
    return float(np.linalg.norm(mesh_vertices(model, geom), axis=1).max())


def bounding_capsule(model: Any, geom: int) -> tuple[Vector3, float]:
    """Half axis in the geom's frame [m] and radius [m] of a capsule that contains it."""
    axis = np.zeros(3)
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
        return axis, float(model.geom_rbound[geom])
    vertices = mesh_vertices(model, geom)
    reach = np.abs(vertices).max(axis=0)
    longest = int(np.argmax(reach))
    width = float(np.linalg.norm(np.delete(vertices, longest, axis=1), axis=1).max())
    axis[longest] = max(reach[longest] - 0.5 * width, 0.0)
    beyond = np.maximum(np.abs(vertices[:, longest]) - axis[longest], 0.0)
    aside = np.linalg.norm(np.delete(vertices, longest, axis=1), axis=1)
    return axis, float(np.hypot(beyond, aside).max())


def mesh_vertices(model: Any, geom: int) -> Floats:
    """(k, 3) vertices of a mesh geom in the geom's frame [m]."""
    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    return np.asarray(model.mesh_vert[first : first + count], float)

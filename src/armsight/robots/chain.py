"""From a URDF's tree to the serial chain of an arm, fixed joints folded away."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Pose
from armsight.errors import RobotError
from armsight.geometry.pose import inverse, make_pose
from armsight.robots.urdf import Geometry, Inertial, Urdf, UrdfJoint

_FLANGE_NAMES = ("tool0", "flange")
LONGEST = 20.0
"""[m] No link of an arm is longer, and no joint farther from the link before it."""


@dataclass(frozen=True)
class ChainLink:
    """What moves as one piece: a link of the chain and all that is fixed to it.

    Attributes:
        name: of the URDF link that carries it.
        T_parent_joint: its joint's frame at zero in the piece before it (identity for the base).
        joint: the joint that moves it; None for the base.
        visuals, collisions: in this piece's frame.
        inertial: of the whole piece; mass 0 where the URDF is silent.
        body: of each of its links what is seen, or its collision geometry where nothing is.
        spheres: whether all of that is covered by collision geometry made of spheres alone.
    """

    name: str
    T_parent_joint: Pose
    joint: UrdfJoint | None
    visuals: tuple[Geometry, ...]
    collisions: tuple[Geometry, ...]
    inertial: Inertial
    body: tuple[Geometry, ...]
    spheres: bool


@dataclass(frozen=True)
class Chain:
    """A serial arm: n + 1 pieces, and the flange in the last one's frame."""

    links: tuple[ChainLink, ...]
    T_last_flange: Pose
    flange: str


def fold_chain(
    urdf: Urdf,
    base: str | None = None,
    flange: str | None = None,
    held: Mapping[str, float] | None = None,
) -> Chain:
    """Find the serial chain of revolute joints and fold everything else into its pieces.

    Args:
        urdf: the tree.
        base: link whose frame becomes ``base``; the root when None. Joints between root and base,
            such as a mobile base's or a lift's, are held.
        flange: link whose frame is the flange, where the chain ends; when None, ``tool0`` or
            ``flange`` if there is one behind the last joint, else the last moving link.
        held: values [rad or m] of moving joints off the chain, such as fingers; 0 by default. What
            mimics one of them goes with it.

    Raises:
        RobotError: no moving joint, a branch, an unknown link, or a joint that is not revolute.
    """
    base = _known(urdf, base, "base") or urdf.root
    before_base = {joint.name for joint in _joints_to(urdf, base)}
    end = _known(urdf, flange, "flange") or _end_of_single_chain(urdf, before_base)
    joints = [joint for joint in _joints_to(urdf, end) if joint.name not in before_base]
    for joint in joints:
        _check_on_chain(urdf, joint)
    if not joints:
        raise _fail(urdf, "has no moving joint between its base and its flange")
    _check_held(urdf, joints, held or {})
    held = _with_mimics(urdf, held or {})

    starts = [urdf.root] + [joint.child for joint in joints]
    stops = {joint.name for joint in joints}
    pieces = [dict(_fixed_links(urdf, start, stops, held)) for start in starts]
    T_base_root = inverse(pieces[0][base])
    pieces[0] = {name: T_base_root @ T for name, T in pieces[0].items()}

    links = []
    for i, piece in enumerate(pieces):
        before = joints[i - 1] if i else None
        T = pieces[i - 1][before.parent] @ before.T_parent_joint if before else np.eye(4)
        links.append(_chain_link(urdf, base if i == 0 else starts[i], piece, T, before))
    flange = flange or next((n for n in _FLANGE_NAMES if n in pieces[-1]), starts[-1])
    return Chain(tuple(links), pieces[-1][flange], flange)


def _known(urdf: Urdf, link: str | None, role: str) -> str | None:
    if link is not None and link not in urdf.links:
        known = ", ".join(urdf.links)
        raise _fail(urdf, f'{role} link "{link}" is unknown; known: {known}')
    return link


def _fail(urdf: Urdf, what: str) -> RobotError:
    return RobotError(f"{urdf.path}: {what}")


def _check_on_chain(urdf: Urdf, joint: UrdfJoint) -> None:
    """Refuses what an arm's chain cannot have."""
    if joint.kind not in ("revolute", "continuous"):
        raise _fail(
            urdf,
            f'joint "{joint.name}" is {joint.kind}, arms here have revolute joints; if it is '
            "before the arm or a gripper's, name the links where the arm begins or ends in its "
            '.toml: base = "...", flange = "..."',
        )
    far = float(np.linalg.norm(joint.T_parent_joint[:3, 3]))
    if far > LONGEST:
        raise _fail(
            urdf,
            f'joint "{joint.name}" <origin>: {far:.3g} m from "{joint.parent}"; lengths are in '
            "metres",
        )
    if joint.mimic:
        raise _fail(
            urdf,
            f'joint "{joint.name}" mimics "{joint.mimic[0]}"; each joint of an arm here moves by '
            "itself; if it is a gripper's, name the link where the arm ends in its .toml: "
            'flange = "..."',
        )


def _end_of_single_chain(urdf: Urdf, before_base: set[str]) -> str:
    """The child of the last moving joint, where all moving joints lie on one line."""
    moving = [j for j in urdf.joints.values() if j.kind != "fixed" and j.name not in before_base]
    if not moving:
        raise _fail(urdf, "has no moving joint behind its base; an arm needs at least one")
    paths = {j.name: _joints_to(urdf, j.child) for j in moving}
    longest = max(paths.values(), key=len)
    off = [j.name for j in moving if j not in longest]
    if off:
        raise _fail(
            urdf,
            f'branches: joint "{off[0]}" is not on the way to "{longest[-1].child}"; '
            'name the arm\'s last link in its .toml: flange = "..."',
        )
    return longest[-1].child


def _joints_to(urdf: Urdf, link: str) -> list[UrdfJoint]:
    """The moving joints from the root to a link, in order."""
    by_child = {j.child: j for j in urdf.joints.values()}
    found = []
    while link != urdf.root:
        joint = by_child[link]
        if joint.kind != "fixed":
            found.append(joint)
        link = joint.parent
    return found[::-1]


def _check_held(urdf: Urdf, joints: list[UrdfJoint], held: Mapping[str, float]) -> None:
    on_chain = {j.name for j in joints}
    for name in held:
        if name not in urdf.joints or name in on_chain:
            raise _fail(urdf, f'held joint "{name}" is not a moving joint off the chain')


def _with_mimics(urdf: Urdf, held: Mapping[str, float]) -> dict[str, float]:
    """The held values, and those of the joints that mimic them."""
    values = dict(held)
    for joint in urdf.joints.values():
        if joint.mimic and joint.name not in held:
            leader, factor, offset = joint.mimic
            values[joint.name] = factor * held.get(leader, 0.0) + offset
    return values


def _fixed_links(
    urdf: Urdf, start: str, stops: set[str], held: Mapping[str, float]
) -> Iterator[tuple[str, Pose]]:
    """Each link that is fixed to ``start`` (itself first) with its pose in ``start``."""
    stack = [(start, np.eye(4))]
    while stack:
        link, T = stack.pop()
        yield link, T
        for joint in reversed(urdf.children(link)):
            if joint.name not in stops:
                stack.append((joint.child, T @ joint.T_parent_joint @ _motion(joint, held)))


def _motion(joint: UrdfJoint, held: Mapping[str, float]) -> Pose:
    """What a joint off the chain, held at its value, adds."""
    value = held.get(joint.name, 0.0)
    if joint.kind in ("fixed", "planar", "floating") or value == 0.0:
        return np.eye(4)
    if joint.kind == "prismatic":
        return make_pose(None, joint.axis * value)
    return make_pose(Rotation.from_rotvec(joint.axis * value).as_matrix())


def _chain_link(
    urdf: Urdf, name: str, piece: dict[str, Pose], T: Pose, joint: UrdfJoint | None
) -> ChainLink:
    def moved(shapes: tuple[Geometry, ...], T_piece_link: Pose) -> list[Geometry]:
        return [replace(s, T_link_geometry=T_piece_link @ s.T_link_geometry) for s in shapes]

    visuals, collisions, body = [], [], []
    spheres = True
    for own, pose in piece.items():
        link = urdf.links[own]
        visuals += moved(link.visuals, pose)
        collisions += moved(link.collisions, pose)
        body += moved(link.visuals or link.collisions, pose)
        covered = bool(link.collisions) or not link.visuals
        spheres &= covered and all(shape.kind == "sphere" for shape in link.collisions)
    inertial = _sum_inertia([(urdf.links[n].inertial, pose) for n, pose in piece.items()])
    return ChainLink(
        name, T, joint, tuple(visuals), tuple(collisions), inertial, tuple(body), spheres
    )


def _sum_inertia(parts: list[tuple[Inertial | None, Pose]]) -> Inertial:
    """Mass, centre and inertia of rigidly joined bodies (parallel axis theorem)."""
    bodies = [(body, T) for body, T in parts if body is not None and body.mass > 0.0]
    mass = sum(body.mass for body, _ in bodies)
    if not bodies:
        return Inertial(0.0, np.zeros(3), np.zeros((3, 3)))
    centers = [T[:3, :3] @ body.center + T[:3, 3] for body, T in bodies]
    center: Floats = sum((b.mass * c for (b, _), c in zip(bodies, centers)), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for (body, T), c in zip(bodies, centers):
        d = c - center
        inertia += T[:3, :3] @ body.inertia @ T[:3, :3].T
        inertia += body.mass * (float(d @ d) * np.eye(3) - np.outer(d, d))
    return Inertial(float(mass), center, inertia)

"""ROS's tree of transforms over time: the tracks of its moving tips in its base."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armsight.arrays import Floats, Pose, Poses
from armsight.geometry.pose import exp, from_quaternion, inverse, log

STILL = 1e-9
"""A transform that never changes by more is static."""


def between(a: Pose, b: Pose, share: float) -> Pose:
    """The pose at a share of the way from one to another."""
    return np.asarray(a @ exp(share * log(inverse(a) @ b)))


@dataclass
class TfTree:
    """Transforms as they were sent.

    Attributes:
        edges: by child, its parent and the (time, x y z qx qy qz qw) of each message.
    """

    edges: dict[str, tuple[str, list[tuple[float, Floats]]]] = field(default_factory=dict)

    def add(self, parent: str, child: str, stamp: float, value: Floats) -> None:
        """One transform: (7,) x y z qx qy qz qw of the child in its parent at a time [s]."""
        self.edges.setdefault(child.strip("/"), (parent.strip("/"), []))[1].append((stamp, value))

    def _moves(self, child: str) -> bool:
        rows = np.array([v for _, v in self.edges[child][1]])
        return bool(np.ptp(rows, axis=0).max() > STILL)

    def _chain(self, child: str) -> list[str]:
        """Frames from a child up to the root, the root left out; cut where it goes in circles."""
        out = [child]
        while (parent := self.edges[out[-1]][0]) in self.edges and parent not in out:
            out.append(parent)
        return out

    def tracks(self) -> dict[str, tuple[Floats, Poses]]:
        """Times and poses of each chain's last moving frame, in the first frame before it moves."""
        out: dict[str, tuple[Floats, Poses]] = {}
        moving = {c for c in self.edges if self._moves(c)}
        inner = {p for c in moving for p in self._chain(c)[1:]}
        for tip in sorted(moving - inner):
            chain = self._chain(tip)[::-1]
            first = next(k for k, c in enumerate(chain) if c in moving)
            links = chain[first:]
            times = np.array(sorted(t for t, _ in self.edges[tip][1]))
            out[f"{self.edges[links[0]][0]}_{tip}"] = times, self._poses(links, times)
        return out

    def _poses(self, links: list[str], times: Floats) -> Poses:
        T = np.tile(np.eye(4), (len(times), 1, 1))
        for link in links:
            T = T @ self._at(link, times)
        return T

    def _at(self, child: str, times: Floats) -> Poses:
        rows = sorted(self.edges[child][1], key=lambda r: r[0])
        at = np.array([t for t, _ in rows])
        P = [from_quaternion(v[3:], v[:3]) for _, v in rows]
        out: list[Pose] = []
        for t in times:
            k = int(np.searchsorted(at, t))
            if k == 0 or k == len(at):
                out.append(P[min(k, len(at) - 1)])
            else:
                out.append(between(P[k - 1], P[k], float((t - at[k - 1]) / (at[k] - at[k - 1]))))
        return np.array(out)

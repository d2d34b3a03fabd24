"""A mount between flange and tool that gives way: where the tool is by what acts on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.geometry.pose import exp, inverse


@dataclass(frozen=True)
class SoftMount:
    """What holds a tool that may give way; its centre of turning is the tool's nominal tip.

    Attributes:
        stiffness: along and about its axes [N/m], [N m/rad].
        most: more than this is not believed to act on it [N], [N m].
        rest: what its weight and cable alone do at most, however it is turned [N], [N m].
    """

    stiffness: tuple[float, float]
    most: tuple[float, float]
    rest: tuple[float, float] = (0.0, 0.0)

    def sag(self, levers: Floats, load: Floats | None = None) -> Floats:
        """(k,) how far what acts on it moves what is no farther than (k,) levers from the tip [m].

        Args:
            levers: [m].
            load: (6,) that acts on the tool now, as of :meth:`load`; what weight and cable do at
                most counts in any case.
        """
        (force, torque), (k, k_turn) = self.rest, self.stiffness
        if load is not None:
            force = max(force, float(np.linalg.norm(load[:3])))
            torque = max(torque, float(np.linalg.norm(load[3:])))
        return np.asarray(force / k + np.asarray(levers, float) * torque / k_turn)

    def load(self, T_flange_tip: Pose, wrench: Floats) -> Floats:
        """(6,) what acts on the tool about its tip, in its axes [N], [N m].

        Args:
            T_flange_tip: the tip when nothing acts on it.
            wrench: (6,) what the sensor at the flange feels, *not* tared [N], [N m], about the
                flange's origin in its axes. What is larger than :attr:`most` counts as that.
        """
        load = at_plug(wrench, T_flange_tip)
        for k, most in enumerate(self.most):
            part = slice(3 * k, 3 * k + 3)
            load[part] *= min(1.0, most / max(float(np.linalg.norm(load[part])), 1e-12))
        return load

    def moved(self, T_flange_tip: Pose, wrench: Floats) -> Pose:
        """``T_flange_moved``: where the tool is, as one that was mounted elsewhere.

        Args: as of :meth:`load`.
        """
        bent = exp(self.load(T_flange_tip, wrench) / np.repeat(self.stiffness, 3))
        return np.asarray(T_flange_tip @ bent @ inverse(T_flange_tip))


def at_plug(wrench: Floats, T_flange_plug: Pose) -> Floats:
    """What a sensor feels at the flange, as what acts on the plug about its origin, in its axes.

    Args:
        wrench: (6,) force [N] and torque [N m] about the flange's origin, in its axes.
        T_flange_plug: where the plug is.
    """
    R, p = T_flange_plug[:3, :3], T_flange_plug[:3, 3]
    force, torque = wrench[:3], wrench[3:] - np.cross(p, wrench[:3])
    return np.concatenate([R.T @ force, R.T @ torque])

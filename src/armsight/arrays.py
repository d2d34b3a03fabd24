"""Array types, defined once: shape, dtype, unit. Shapes are documented, not enforced."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Pose: TypeAlias = NDArray[np.float64]
"""(4, 4) rigid transform ``T_a_b``: maps coordinates in b to coordinates in a; lengths in [m]."""
Poses: TypeAlias = NDArray[np.float64]
"""(n, 4, 4) rigid transforms."""
Rotation3: TypeAlias = NDArray[np.float64]
"""(3, 3) rotation matrix."""
Vector3: TypeAlias = NDArray[np.float64]
"""(3,) a position [m] or direction."""
Points: TypeAlias = NDArray[np.floating]
"""(n, 3) positions [m]."""
JointVector: TypeAlias = NDArray[np.float64]
"""(n,) one value a joint in the URDF's order: [rad], [rad/s] or [rad/s^2]."""
JointPath: TypeAlias = NDArray[np.float64]
"""(k, n) joint positions [rad], one row a waypoint."""
DepthImage: TypeAlias = NDArray[np.float32]
"""(h, w) depth along the optical axis [m], NaN where there is no return (REP-118)."""
ColorImage: TypeAlias = NDArray[np.uint8]
"""(h, w, 3) RGB."""
Mask: TypeAlias = NDArray[np.bool_]
"""(h, w) or (n,) truth values."""
Shorts: TypeAlias = NDArray[np.uint16]
Words: TypeAlias = NDArray[np.uint64]
Floats: TypeAlias = NDArray[np.float64]
Floats32: TypeAlias = NDArray[np.float32]
Ints: TypeAlias = NDArray[np.int64]
Ints32: TypeAlias = NDArray[np.int32]
Bytes: TypeAlias = NDArray[np.uint8]
SignedBytes: TypeAlias = NDArray[np.int8]
SignedShorts: TypeAlias = NDArray[np.int16]

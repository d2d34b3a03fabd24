"""What a camera that stands still sees of the declared solids: most pixels are settled by it.

Nearly all of an image of a cell shows its walls, floor and table. Working out for each pixel of
each frame that its point lies on one of them costs more than anything else that is done with it;
so it is worked out once, as the depths between which a pixel shows its first solid or something
outside the map.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import Bytes, Floats, Floats32, Pose
from armsight.mapping.kernels.pixels import VALID
from armsight.mapping.kernels.solids import trace_solids, unexplained
from armsight.mapping.lens import DepthLens
from armsight.mapping.static_geometry import StaticGeometry


class Backdrop:
    """The depths at which declared solids explain each pixel of one camera.

    Args:
        lens: of the camera.
        range_: least and greatest depth of the camera [m].
        noise: (3,) a, b, c of its sigma(z) = a + b z + c z^2 [m].
        static: the declared solids, on the outermost grid.
    """

    def __init__(
        self, lens: DepthLens, range_: tuple[float, float], noise: Floats, static: StaticGeometry
    ) -> None:
        self._lens = lens
        self._range = range_
        self._noise = noise
        self._solids = static.table
        grid = static.grid
        self._lower = np.asarray(grid.origin, float)
        self._upper = self._lower + grid.voxel * np.asarray(grid.shape)
        shape = lens.rays.shape[:2]
        self._first: Floats32 = np.zeros(shape, np.float32)
        self._last: Floats32 = np.zeros(shape, np.float32)
        self._todo: Bytes = np.zeros(shape, np.uint8)
        self._seen_from: tuple[bytes, tuple[float, float, float]] | None = None
        self._traced = False

    def unexplained(
        self, depth: Floats32, label: Bytes, T: Pose, tolerance: tuple[float, float, float]
    ) -> Bytes:
        """(h, w) uint8, 1 where a usable pixel may show something undeclared.

        Nobody should rely on a 1: only a camera that has not moved since its last frame gets any
        pixel settled here, and only by the solid that its ray meets first.

        Args:
            depth: (h, w) float32 [m].
            label: (h, w) uint8.
            T: camera in ``base``.
            tolerance: (m, rad, sigmas): within m + rad x depth + sigmas x sigma of a solid's
                surface a point is the solid.
        """
        seen_from = (T.tobytes(), tolerance)
        if seen_from != self._seen_from:
            self._seen_from, self._traced = seen_from, False
            return np.equal(label, VALID, out=self._todo.view(bool)).view(np.uint8)
        if not self._traced:
            near, far = self._range
            trace_solids(
                self._lens.rays,
                T,
                self._noise,
                near,
                far,
                self._lower,
                self._upper,
                self._solids,
                tolerance,
                self._first,
                self._last,
            )
            self._traced = True
        unexplained(depth, label, self._first, self._last, self._todo)
        return self._todo

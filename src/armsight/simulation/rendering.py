"""Pictures of the cell: depth with segmentation in one pass, colour on demand."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Lock
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from armsight.arrays import ColorImage, DepthImage, Pose
from armsight.geometry.camera import PinholeCamera
from armsight.simulation.gl import OpenGLContext, mujoco
from armsight.simulation.kernels import merge_buffers, resample_depth
from armsight.simulation.lens import RenderLens, aim_scene, render_lens
from armsight.simulation.looks import FAR, NEAR
from armsight.simulation.model import CellModel
from armsight.simulation.model_parts import COARSE, COLOR_ONLY, DEPTH_ONLY, FINE, SEEN
from armsight.simulation.static_background import Buffers, Window, reach_of_spheres

GeomImage = NDArray[np.int16]
"""(h, w) index of the geom seen, -1 for none; ``CellModel.parts`` says what each is."""

Kind = Literal["depth", "color", "still"]
"""Depth; colour as a camera at work takes it; colour as fine as can be, in five times the time."""
_GROUPS: dict[Kind, tuple[int, ...]] = {
    "depth": (SEEN, COARSE, DEPTH_ONLY),
    "color": (SEEN, COARSE, COLOR_ONLY),
    "still": (SEEN, FINE, COLOR_ONLY),
}
_SHADOWS: dict[Kind, int] = {"depth": 0, "color": 1024, "still": 2048}
_BLUR = 0.5
"""Of a camera's optics, standard deviation [px]; it stands in for antialiasing."""
STILL_LIVES = 16
"""Fixed views of which the unmoving part is kept."""


@dataclass(frozen=True)
class DepthPicture:
    """What an ideal depth camera sees.

    Attributes:
        depth: (h, w) float32 [m] along the optical axis, NaN where there is nothing.
        geom: (h, w) index of the geom seen, -1 for none.
    """

    depth: DepthImage
    geom: GeomImage


class Shot:
    """The cell at one instant, ready to be rendered from one lens later and by another thread.

    Attributes:
        scene: what is drawn.
        kind: what of it.
        still: what never moves; then ``scene`` lacks it.
        reach: the part of the render lens's picture outside which the picture is the still one.
    """

    def __init__(self, model: Any) -> None:
        self.scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 64)
        self.kind: Kind = "depth"
        self.still: StillLife | None = None
        self.reach: Window = (0, 0, 0, 0)


class StillLife:
    """What never moves, before one fixed lens; drawn when it is first wanted.

    Attributes:
        shot: of it, until it is drawn.
        lock: held while it is drawn.
        buffers: as drawn.
        picture: through the lens.
    """

    def __init__(self, shot: Shot) -> None:
        self.shot: Shot | None = shot
        self.lock = Lock()
        self.buffers: Buffers | None = None
        self.picture: DepthPicture | None = None


class Renderer:
    """Renders a compiled cell from any camera pose.

    A shot (:meth:`take`) freezes the cell; :meth:`depth` and :meth:`color` draw shots. Threads may
    share a renderer: drawing is serialised.
    """

    def __init__(self, cell: CellModel, still_samples: int = 4) -> None:
        """Prepare to draw.

        Args:
            cell: the compiled cell.
            still_samples: of antialiasing in stills; 0 for none, in half the time.
        """
        self._cell = cell
        self._samples: dict[Kind, int] = {"depth": 0, "color": 0, "still": still_samples}
        self._gl_or_none: OpenGLContext | None = None
        self._contexts: dict[Kind, Any] = {}
        self._options = {kind: _option(groups) for kind, groups in _GROUPS.items()}
        self._free = mujoco.MjvCamera()
        self._spare: list[Shot] = []
        self._geom_of_id: dict[tuple[Kind, bool, int], NDArray[np.int16]] = {}
        self._still: dict[tuple[PinholeCamera, bytes], StillLife] = {}
        self._moving = _moving_geoms(cell.model)

    def open(self) -> None:
        """Make the OpenGL context now rather than with the first picture.

        Raises:
            ArmsightError: there is no OpenGL; says what to install.
        """
        if self._gl_or_none is None:
            self._gl_or_none = OpenGLContext()

    @property
    def _gl(self) -> OpenGLContext:
        self.open()
        assert self._gl_or_none is not None
        return self._gl_or_none

    def take(
        self,
        data: Any,
        T_world_camera: Pose,
        lens: PinholeCamera,
        kind: Kind = "depth",
        fixed: bool = False,
    ) -> Shot:
        """Freeze the cell as ``data`` has it, seen by a lens at an optical pose in world.

        Args:
            data: MuJoCo's state.
            T_world_camera: optical pose.
            lens: of the camera.
            kind: what will be drawn of it.
            fixed: whether depth will often be taken from this very pose.
        """
        if not fixed or kind != "depth":
            return self._freeze(data, T_world_camera, lens, kind, mujoco.mjtCatBit.mjCAT_ALL)
        key = (lens, T_world_camera.tobytes())
        still = self._still.get(key)
        if still is None:
            while len(self._still) >= STILL_LIVES:  # a camera that is moved leaves them behind
                self._still.pop(next(iter(self._still)))
            frozen = self._freeze(data, T_world_camera, lens, kind, mujoco.mjtCatBit.mjCAT_STATIC)
            still = self._still[key] = StillLife(frozen)
        shot = self._freeze(data, T_world_camera, lens, kind, mujoco.mjtCatBit.mjCAT_DYNAMIC)
        shot.still = still
        shot.reach = reach_of_spheres(
            data.geom_xpos[self._moving],
            self._cell.model.geom_rbound[self._moving],
            T_world_camera,
            render_lens(lens).pinhole,
        )
        return shot

    def _freeze(
        self, data: Any, T_world_camera: Pose, lens: PinholeCamera, kind: Kind, categories: Any
    ) -> Shot:
        shot = self._spare.pop() if self._spare else Shot(self._cell.model)
        shot.kind, shot.still = kind, None
        # An endless floor is drawn around the camera that the scene had before, so aim first.
        self.aim(shot, T_world_camera, lens)
        mujoco.mjv_updateScene(
            self._cell.model,
            data,
            self._options[kind],
            None,
            self._free,
            categories,
            shot.scene,
        )
        self.aim(shot, T_world_camera, lens)
        return shot

    def aim(self, shot: Shot, T_world_camera: Pose, lens: PinholeCamera) -> None:
        """Point a shot elsewhere."""
        aim_scene(shot.scene, T_world_camera, render_lens(lens).pinhole, NEAR, FAR)

    def give_back(self, shot: Shot) -> None:
        """A shot that is no longer needed may be used again."""
        self._spare.append(shot)

    def depth(self, shot: Shot, lens: PinholeCamera) -> DepthPicture:
        """Depth and segmentation of a shot aimed with the same lens."""
        view = render_lens(lens)
        if shot.still is None:
            return _through(lens, self._buffers(shot, view))
        still, beneath = self._still_life(shot.still, lens)
        if shot.reach[0] == shot.reach[1]:
            return DepthPicture(still.depth.copy(), still.geom.copy())
        part = self._buffers(shot, view, shot.reach)
        ids, raw, codes = beneath.ids.copy(), beneath.raw.copy(), len(beneath.geom_of_id)
        row, column = view.pinhole.height - shot.reach[1], shot.reach[2]
        merge_buffers(ids, raw, part.ids, part.raw, row, column, codes)
        table = np.concatenate([beneath.geom_of_id, part.geom_of_id])
        return _through(lens, Buffers(ids, raw, table), still, view.window_of(shot.reach))

    def _still_life(self, still: StillLife, lens: PinholeCamera) -> tuple[DepthPicture, Buffers]:
        with still.lock:
            if still.picture is None or still.buffers is None:
                assert still.shot is not None
                still.buffers = self._buffers(still.shot, render_lens(lens))
                still.picture = _through(lens, still.buffers)
                self.give_back(still.shot)
                still.shot = None
            return still.picture, still.buffers

    def _buffers(self, shot: Shot, view: RenderLens, window: Window | None = None) -> Buffers:
        """Draw a shot and read it, or a part of it."""
        top, bottom, left, right = window or (0, view.pinhole.height, 0, view.pinhole.width)
        ids = np.empty((bottom - top, right - left), np.uint32)
        raw = np.empty((bottom - top, right - left), np.float32)
        _set_flags(shot, _DEPTH_FLAGS)
        with self._gl.current():
            self._draw(shot, view, "depth")
            _read(left, view.pinhole.height - bottom, ids, raw)
        return Buffers(ids, raw, self._geom_table(shot))

    def color(self, shot: Shot, lens: PinholeCamera, shadows: bool = True) -> ColorImage:
        """(h, w, 3) colour picture, or still, of a shot aimed with the same lens."""
        view = render_lens(lens)
        pixels = np.empty((view.pinhole.height, view.pinhole.width, 3), np.uint8)
        _set_flags(shot, _COLOR_FLAGS if shadows else _COLOR_FLAGS - {_FLAG.mjRND_SHADOW})
        with self._gl.current():
            rect, context = self._draw(shot, view, shot.kind)
            mujoco.mjr_readPixels(pixels, None, rect, context)
        upright = np.ascontiguousarray(pixels[::-1])
        image = cv2.remap(upright, view.map_u, view.map_v, cv2.INTER_LINEAR)
        if shot.kind == "color":
            image = cv2.GaussianBlur(image, (3, 3), _BLUR)
        return np.asarray(image)

    def close(self) -> None:
        """Give OpenGL's memory back; may be repeated."""
        if self._gl_or_none is None:
            return
        with self._gl_or_none.current():
            for context in self._contexts.values():
                context.free()
            self._contexts.clear()
        self._spare.clear()
        self._still.clear()
        self._gl_or_none.close()
        self._gl_or_none = None

    def _draw(self, shot: Shot, view: RenderLens, kind: Kind) -> tuple[Any, Any]:
        context = self._context(kind, view.pinhole.width, view.pinhole.height)
        rect = mujoco.MjrRect(0, 0, view.pinhole.width, view.pinhole.height)
        mujoco.mjr_render(rect, shot.scene, context)
        return rect, context

    def _context(self, kind: Kind, width: int, height: int) -> Any:
        """Drawing state with antialiasing and shadows as fine as the kind asks, large enough."""
        model = self._cell.model
        context = self._contexts.get(kind)
        if context is None:
            model.vis.quality.offsamples = self._samples[kind]
            model.vis.quality.shadowsize = _SHADOWS[kind]
            context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
            context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
            self._contexts[kind] = context
        if width > context.offWidth or height > context.offHeight:
            mujoco.mjr_resizeOffscreen(
                max(width, context.offWidth), max(height, context.offHeight), context
            )
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
        return context

    def _geom_table(self, shot: Shot) -> NDArray[np.int16]:
        """Geom of each segmentation id; the scene lists the geoms in the same order every time."""
        key = (shot.kind, shot.still is None, shot.scene.ngeom)
        table = self._geom_of_id.get(key)
        if table is None:
            table = np.full(shot.scene.ngeom + 1, -1, np.int16)
            for geom in shot.scene.geoms[: shot.scene.ngeom]:
                if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                    table[geom.segid + 1] = geom.objid
            self._geom_of_id[key] = table
        return table


_FLAG = mujoco.mjtRndFlag
_DEPTH_FLAGS = frozenset({_FLAG.mjRND_SEGMENT, _FLAG.mjRND_IDCOLOR, _FLAG.mjRND_CULL_FACE})
_COLOR_FLAGS = frozenset(
    {
        _FLAG.mjRND_SHADOW,
        _FLAG.mjRND_SKYBOX,
        _FLAG.mjRND_FOG,  # the floor's far end fades into the sky
        _FLAG.mjRND_CULL_FACE,
    }
)


def _option(groups: tuple[int, ...]) -> Any:
    """What of a scene is drawn: these groups of geoms, and nothing that is no geom."""
    option = mujoco.MjvOption()
    option.label = mujoco.mjtLabel.mjLABEL_NONE
    option.geomgroup[:] = 0
    for group in groups:
        option.geomgroup[group] = 1
    return option


def _set_flags(shot: Shot, on: frozenset[Any]) -> None:
    """Every flag anew: a shot may have been drawn in another way before."""
    shot.scene.flags[:] = 0
    for flag in on:
        shot.scene.flags[flag] = 1


def _read(left: int, bottom: int, ids: NDArray[np.uint32], raw: DepthImage) -> None:
    """A part of both buffers in OpenGL's own layout, half the time of ``mjr_readPixels``."""
    from OpenGL import GL  # type: ignore[import-untyped]  # gl.py has chosen the platform

    height, width = ids.shape
    # PyOpenGL copies an array of another type than it is told of, so it gets the very bytes.
    pixels = ids.view(np.uint8)
    GL.glReadPixels(left, bottom, width, height, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, pixels)
    GL.glReadPixels(left, bottom, width, height, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT, raw)


def _through(
    lens: PinholeCamera,
    buffers: Buffers,
    still: DepthPicture | None = None,
    window: Window | None = None,
) -> DepthPicture:
    """A lens's picture from what was drawn; outside a window it is known already."""
    view = render_lens(lens)
    if still is None or window is None:
        window = (0, lens.height, 0, lens.width)
        depth = np.empty((lens.height, lens.width), np.float32)
        geom = np.empty((lens.height, lens.width), np.int16)
    else:
        depth, geom = still.depth.copy(), still.geom.copy()
    offset, factor = _depth_coefficients()
    resample_depth(
        buffers.raw,
        buffers.ids,
        view.corner,
        view.weight_u,
        view.weight_v,
        buffers.geom_of_id,
        offset,
        factor,
        window,
        depth,
        geom,
    )
    return DepthPicture(depth, geom)


def _moving_geoms(model: Any) -> NDArray[np.int64]:
    """Indices of the geoms that depth cameras see and that are not fixed to the world."""
    body = model.geom_bodyid
    held = (model.body_weldid[body] == 0) & (model.body_mocapid[model.body_rootid[body]] < 0)
    seen = np.isin(model.geom_group, _GROUPS["depth"])
    return np.flatnonzero(seen & ~held)


def _depth_coefficients() -> tuple[float, float]:
    """``z = factor / (raw + offset)`` for a reversed depth buffer (1 near, 0 far)."""
    near, far = np.float32(NEAR), np.float32(FAR)
    offset = 0.5 * (far + near) / (far - near) - 0.5
    factor = far * near / (far - near)
    return float(offset), float(factor)

"""Pictures of the cell: depth with segmentation in one pass, colour on demand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from armsight.arrays import ColorImage, DepthImage, Pose
from armsight.geometry.camera import PinholeCamera
from armsight.simulation.gl import OpenGLContext, mujoco
from armsight.simulation.kernels import resample_depth
from armsight.simulation.lens import RenderLens, render_lens
from armsight.simulation.looks import FAR, NEAR
from armsight.simulation.model import COLOR_ONLY, DEPTH_ONLY, SEEN, CellModel

GeomImage = NDArray[np.int16]
"""(h, w) index of the geom seen, -1 for none; ``CellModel.parts`` says what each is."""

Kind = Literal["depth", "color"]
_GROUPS: dict[Kind, tuple[int, ...]] = {
    "depth": (SEEN, DEPTH_ONLY),
    "color": (SEEN, COLOR_ONLY),
}
_SAMPLES = {"depth": 0, "color": 4}
_SHADOWS = {"depth": 0, "color": 2048}


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
    """The cell at one instant, ready to be rendered from one lens later and by another thread."""

    def __init__(self, model: Any) -> None:
        self.scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 64)
        self.kind: Kind = "depth"


class Renderer:
    """Renders a compiled cell from any camera pose.

    A shot (:meth:`take`) freezes the cell; :meth:`depth` and :meth:`color` draw shots. Threads may
    share a renderer: drawing is serialised.
    """

    def __init__(self, cell: CellModel) -> None:
        self._cell = cell
        self._gl_or_none: OpenGLContext | None = None
        self._contexts: dict[str, Any] = {}
        self._options = {kind: _option(groups) for kind, groups in _GROUPS.items()}
        self._free = mujoco.MjvCamera()
        self._spare: list[Shot] = []
        self._geom_of_id: dict[Kind, NDArray[np.int16]] = {}

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
        self, data: Any, T_world_camera: Pose, lens: PinholeCamera, kind: Kind = "depth"
    ) -> Shot:
        """Freeze the cell as ``data`` has it, seen by a lens at an optical pose in world.

        Args:
            data: MuJoCo's state.
            T_world_camera: optical pose.
            lens: of the camera.
            kind: what will be drawn of it.
        """
        shot = self._spare.pop() if self._spare else Shot(self._cell.model)
        shot.kind = kind
        # An endless floor is drawn around the camera that the scene had before, so aim first.
        self.aim(shot, T_world_camera, lens)
        mujoco.mjv_updateScene(
            self._cell.model,
            data,
            self._options[kind],
            None,
            self._free,
            mujoco.mjtCatBit.mjCAT_ALL,
            shot.scene,
        )
        self.aim(shot, T_world_camera, lens)
        return shot

    def aim(self, shot: Shot, T_world_camera: Pose, lens: PinholeCamera) -> None:
        """Point a shot elsewhere."""
        pinhole = render_lens(lens).pinhole
        left = (-0.5 - pinhole.cx) / pinhole.fx
        right = (pinhole.width - 0.5 - pinhole.cx) / pinhole.fx
        top = (pinhole.cy + 0.5) / pinhole.fy
        bottom = (pinhole.cy + 0.5 - pinhole.height) / pinhole.fy
        for camera in shot.scene.camera:
            camera.pos[:] = T_world_camera[:3, 3]
            camera.forward[:] = T_world_camera[:3, 2]
            camera.up[:] = -T_world_camera[:3, 1]
            camera.frustum_near, camera.frustum_far = NEAR, FAR
            camera.frustum_center = 0.5 * (left + right) * NEAR
            camera.frustum_width = 0.5 * (right - left) * NEAR
            camera.frustum_bottom, camera.frustum_top = bottom * NEAR, top * NEAR

    def give_back(self, shot: Shot) -> None:
        """A shot that is no longer needed may be used again."""
        self._spare.append(shot)

    def depth(self, shot: Shot, lens: PinholeCamera) -> DepthPicture:
        """Depth and segmentation of a shot aimed with the same lens."""
        view = render_lens(lens)
        w, h = view.pinhole.width, view.pinhole.height
        ids = np.empty((h, w), np.uint32)
        raw = np.empty((h, w), np.float32)
        _set_flags(shot, _DEPTH_FLAGS)
        with self._gl.current():
            self._draw(shot, view, "depth")
            _read(w, h, ids, raw)
        geom_of_id = self._geom_table(shot)
        depth = np.empty((lens.height, lens.width), np.float32)
        geom = np.empty((lens.height, lens.width), np.int16)
        offset, factor = _depth_coefficients()
        resample_depth(
            raw,
            ids,
            view.corner,
            view.weight_u,
            view.weight_v,
            geom_of_id,
            offset,
            factor,
            depth,
            geom,
        )
        return DepthPicture(depth, geom)

    def color(self, shot: Shot, lens: PinholeCamera, shadows: bool = True) -> ColorImage:
        """(h, w, 3) colour picture of a shot aimed with the same lens."""
        view = render_lens(lens)
        pixels = np.empty((view.pinhole.height, view.pinhole.width, 3), np.uint8)
        _set_flags(shot, _COLOR_FLAGS if shadows else _COLOR_FLAGS - {_FLAG.mjRND_SHADOW})
        with self._gl.current():
            rect, context = self._draw(shot, view, "color")
            mujoco.mjr_readPixels(pixels, None, rect, context)
        upright = np.ascontiguousarray(pixels[::-1])
        return np.asarray(cv2.remap(upright, view.map_u, view.map_v, cv2.INTER_LINEAR))

    def close(self) -> None:
        """Give OpenGL's memory back; may be repeated."""
        if self._gl_or_none is None:
            return
        with self._gl_or_none.current():
            for context in self._contexts.values():
                context.free()
            self._contexts.clear()
        self._spare.clear()
        self._gl_or_none.close()
        self._gl_or_none = None

    def _draw(self, shot: Shot, view: RenderLens, kind: str) -> tuple[Any, Any]:
        context = self._context(kind, view.pinhole.width, view.pinhole.height)
        rect = mujoco.MjrRect(0, 0, view.pinhole.width, view.pinhole.height)
        mujoco.mjr_render(rect, shot.scene, context)
        return rect, context

    def _context(self, kind: str, width: int, height: int) -> Any:
        """Drawing state without antialiasing for depth and with it for colour, large enough."""
        model = self._cell.model
        context = self._contexts.get(kind)
        if context is None:
            model.vis.quality.offsamples = _SAMPLES[kind]
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
        table = self._geom_of_id.get(shot.kind)
        if table is None or len(table) != shot.scene.ngeom + 1:
            table = np.full(shot.scene.ngeom + 1, -1, np.int16)
            for geom in shot.scene.geoms[: shot.scene.ngeom]:
                if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                    table[geom.segid + 1] = geom.objid
            self._geom_of_id[shot.kind] = table
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


def _read(width: int, height: int, ids: NDArray[np.uint32], raw: DepthImage) -> None:
    """Both buffers in OpenGL's own layout, half the time of ``mjr_readPixels``."""
    from OpenGL import GL  # type: ignore[import-untyped]  # gl.py has chosen the platform

    # PyOpenGL copies an array of another type than it is told of, so it gets the very bytes.
    pixels = ids.view(np.uint8)
    GL.glReadPixels(0, 0, width, height, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, pixels)
    GL.glReadPixels(0, 0, width, height, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT, raw)


def _depth_coefficients() -> tuple[float, float]:
    """``z = factor / (raw + offset)`` for a reversed depth buffer (1 near, 0 far)."""
    near, far = np.float32(NEAR), np.float32(FAR)
    offset = 0.5 * (far + near) / (far - near) - 0.5
    factor = far * near / (far - near)
    return float(offset), float(factor)

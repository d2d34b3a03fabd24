"""Draws a :class:`Scene` with MuJoCo's renderer: colour, and which link each pixel sees.

MuJoCo's model is only the store of meshes and textures here; the scene itself is filled by hand,
so that nothing is compiled between two pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armsight.arrays import Bytes, ColorImage, Pose
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import make_pose
from armsight.recognition.data.sample import KNOWN_ROBOTS
from armsight.recognition.data.things import Lamp, Scene, Surface, Thing
from armsight.robots.catalogue import load_robot
from armsight.robots.meshes import read_mesh
from armsight.robots.tools import TOOL_NAMES, load_tool
from armsight.simulation.gl import OpenGLContext, mujoco
from armsight.simulation.lens import aim_scene

TEXTURES = 6
TEXTURE_SIZE = 256
NEAR, FAR = 0.05, 30.0
REPEATS = (0.3, 0.7, 1.5, 3.0)
"""Repetitions of a texture a metre that can be had."""
MAX_THINGS = 600
SHADOW_MAP = 1024


class Painter:
    """An OpenGL context with every mesh of some robots in it. One a process; not thread safe.

    Attributes:
        robots: names, or paths of a user's own.

    Raises:
        ArmsightError: there is no OpenGL; says what to install.
    """

    def __init__(self, robots: Sequence[str] = KNOWN_ROBOTS) -> None:
        self.robots = tuple(robots)
        self._model, self._mesh_of, offsets = _store(robots)
        self._offset = {name: offsets[k] for name, k in self._mesh_of.items()}
        self._gl = OpenGLContext()
        self._context: Any = None
        self._scene = mujoco.MjvScene(self._model, maxgeom=MAX_THINGS)
        self._uploaded: list[Bytes | None] = [None] * TEXTURES

    def color(self, scene: Scene, T_world_camera: Pose, lens: PinholeCamera) -> ColorImage:
        """(h, w, 3) what an ideal lens sees, without antialiasing."""
        self._fill(scene.things, labels=False)
        self._light(scene)
        flags = [_FLAG.mjRND_CULL_FACE]
        if any(lamp.shadow for lamp in scene.lamps):
            flags.append(_FLAG.mjRND_SHADOW)
        if any(thing.surface.reflectance > 0 for thing in scene.things):
            flags.append(_FLAG.mjRND_REFLECTION)
        with self._gl.current():
            self._ready(lens)
            for slot, picture in enumerate(scene.textures[:TEXTURES]):
                if picture is not self._uploaded[slot]:  # cameras of one scene share them
                    self._upload(slot, picture)
            return self._draw(T_world_camera, lens, flags)

    def labels(self, things: Sequence[Thing], T_world_camera: Pose, lens: PinholeCamera) -> Bytes:
        """(h, w) label of the thing that each pixel's centre sees, 0 for no robot."""
        self._fill(things, labels=True)
        self._scene.nlight = 0
        flags = [_FLAG.mjRND_CULL_FACE, _FLAG.mjRND_SEGMENT, _FLAG.mjRND_IDCOLOR]
        with self._gl.current():
            self._ready(lens)
            pixels = self._draw(T_world_camera, lens, flags)
        # MuJoCo writes segid + 1; labels are below 255, so the first byte holds all of it.
        seen = pixels[..., 0].astype(np.int16) - 1
        return np.asarray(np.where(seen < 0, 0, seen), np.uint8)

    def close(self) -> None:
        """Give OpenGL's memory back; may be repeated."""
        if self._context is not None:
            with self._gl.current():
                self._context.free()
            self._context = None
        self._gl.close()

    def _ready(self, lens: PinholeCamera) -> None:
        if self._context is None:
            self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_50)
        context = self._context
        if lens.width > context.offWidth or lens.height > context.offHeight:
            mujoco.mjr_resizeOffscreen(
                max(lens.width, context.offWidth), max(lens.height, context.offHeight), context
            )
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)

    def _upload(self, slot: int, picture: Bytes) -> None:
        start = self._model.tex_adr[slot]
        self._model.tex_data[start : start + picture.size] = picture.ravel()
        mujoco.mjr_uploadTexture(self._model, self._context, slot)
        self._uploaded[slot] = picture

    def _draw(self, T: Pose, lens: PinholeCamera, flags: list[Any]) -> ColorImage:
        aim_scene(self._scene, T, lens, NEAR, FAR)
        self._scene.flags[:] = 0
        for flag in flags:
            self._scene.flags[flag] = 1
        rect = mujoco.MjrRect(0, 0, lens.width, lens.height)
        pixels = np.empty((lens.height, lens.width, 3), np.uint8)
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(pixels, None, rect, self._context)
        return pixels[::-1]

    def _fill(self, things: Sequence[Thing], labels: bool) -> None:
        if len(things) > MAX_THINGS:
            raise ValueError(f"a scene of {len(things)} things, at most {MAX_THINGS} can be drawn")
        for geom, thing in zip(self._scene.geoms, things):
            surface = thing.surface
            T = thing.T_world_thing
            if thing.kind == "mesh":
                T = T @ self._offset[thing.mesh]
            mujoco.mjv_initGeom(
                geom,
                _KINDS[thing.kind],
                np.asarray(thing.size, float),
                T[:3, 3],
                np.ascontiguousarray(T[:3, :3]).ravel(),
                np.array([*surface.color, 1.0], np.float32),
            )
            geom.size[:] = thing.size  # initGeom reads a rod's in another order
            # The scene's memory comes as it is; what initGeom leaves out would be left to chance.
            geom.transparent = geom.texcoord = 0
            geom.modelrbound = geom.camdist = 0.0
            geom.objid, geom.category = 0, int(mujoco.mjtCatBit.mjCAT_STATIC)
            geom.objtype = mujoco.mjtObj.mjOBJ_GEOM
            geom.dataid = 2 * self._mesh_of[thing.mesh] if thing.kind == "mesh" else -1
            geom.segid = thing.label
            geom.specular, geom.shininess = surface.specular, surface.shininess
            geom.emission, geom.reflectance = surface.emission, surface.reflectance
            geom.matid = -1 if labels else _material(surface)
        self._scene.ngeom = len(things)

    def _light(self, scene: Scene) -> None:
        head = Lamp(np.zeros(3), np.array([0.0, 0.0, -1.0]), (0.0, 0.0, 0.0), 0.0, 180.0)
        lamps = [head, *scene.lamps]
        for k, (light, lamp) in enumerate(zip(self._scene.lights, lamps)):
            light.pos[:], light.dir[:] = lamp.position, lamp.direction
            light.type = mujoco.mjtLightType.mjLIGHT_SPOT
            light.headlight, light.castshadow = 0, int(lamp.shadow)
            light.id, light.texid = k, -1
            light.intensity, light.range, light.bulbradius = 0.0, FAR, 0.02
            light.ambient[:] = scene.ambient if k == 0 else 0.0
            light.diffuse[:], light.specular[:] = lamp.color, lamp.specular
            light.attenuation[:] = lamp.attenuation
            light.cutoff, light.exponent = lamp.cutoff_deg, lamp.exponent
        self._scene.nlight = min(len(lamps), len(self._scene.lights))


_FLAG = mujoco.mjtRndFlag
_KINDS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "mesh": mujoco.mjtGeom.mjGEOM_MESH,
}


def _material(surface: Surface) -> int:
    """Number of the material with a surface's texture, -1 for none."""
    if surface.texture < 0:
        return -1
    nearest = int(np.argmin([abs(np.log(surface.repeat / r)) for r in REPEATS]))
    return surface.texture * len(REPEATS) + nearest


def _store(robots: Sequence[str]) -> tuple[Any, dict[str, int], list[Pose]]:
    """A model that holds meshes and empty textures; number and offset of each mesh."""
    spec = mujoco.MjSpec()
    spec.visual.quality.offsamples = 0
    spec.visual.quality.shadowsize = SHADOW_MAP
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 24, 12
    spec.visual.map.znear, spec.visual.map.zfar = NEAR, FAR
    spec.stat.extent = 1.0
    for slot in range(TEXTURES):
        texture = spec.add_texture(
            name=f"{slot}",
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            width=TEXTURE_SIZE,
            height=TEXTURE_SIZE,
            nchannel=3,
        )
        texture.data = bytes(TEXTURE_SIZE * TEXTURE_SIZE * 3)
        for k, repeat in enumerate(REPEATS):
            material = spec.add_material(
                name=f"{slot}/{k}", texrepeat=(repeat, repeat), texuniform=True
            )
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = f"{slot}"
    meshes = [(f"{r}/{k}", m) for r in robots for k, m in enumerate(load_robot(r).meshes)]
    meshes += [(f"{t}/{k}", m) for t in TOOL_NAMES for k, m in enumerate(load_tool(t).meshes)]
    for name, mesh in meshes:
        vertices, faces = read_mesh(mesh)
        spec.add_mesh(
            name=name,
            uservert=vertices.ravel(),
            userface=faces.ravel().astype(np.int32),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, contype=0, conaffinity=0
        )
    model = spec.compile()
    numbers, offsets = {}, []
    for k, (name, _) in enumerate(meshes):
        numbers[name] = k
        R = np.empty(9)
        mujoco.mju_quat2Mat(R, model.mesh_quat[k])
        offsets.append(make_pose(R.reshape(3, 3), model.mesh_pos[k]))
    return model, numbers, offsets

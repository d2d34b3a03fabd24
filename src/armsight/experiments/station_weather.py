"""Where a visit's standing pair is, and the light, dirt and wet in which the port is seen.

What a renderer lacks is laid over the pictures, as in `port-pose` (``port_weather.py``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from armsight.arrays import ColorImage, Floats, Pose, Vector3
from armsight.devices.data import StereoFrame, StereoInfo
from armsight.experiments.port_scene import LIGHTS, Light
from armsight.experiments.port_weather import Style, expose, weather
from armsight.geometry.pose import inverse
from armsight.simulation.spec import WorldSpec
from armsight.simulation.world import SimulatedWorld
from armsight.workcell.schema import Workcell

POST = "post"
"""The standing pair of the packaged cells."""
PLACES: dict[str, Vector3 | None] = {
    "as packaged": None,
    "near": np.array([0.05, 0.45, 1.15]),
    "far": np.array([-1.10, 1.00, 1.30]),
    "other side": np.array([-0.45, -0.68, 1.00]),
}
"""Of the standing pair in world [m]: 1.6, 1.0, 2.3 and 1.6 m from the packaged car's port."""
SUN = 1.5
"""A low sun's lamp is so far from the port, within the walls of the cell [m]."""
BRIGHT = {"indoor": 1.0, "dim": 0.3, "low_sun": 0.55, "overcast": 0.4, "glare": 1.0}
AROUND = {"indoor": 1.0, "dim": 0.3, "low_sun": 0.7, "overcast": 2.0, "glare": 1.4}
GAIN = {"glare": 1.6}
"""Of the lamps, of what comes from everywhere, and of the exposure, in each light."""


@dataclass(frozen=True)
class Surroundings:
    """Of one visit.

    Attributes:
        place: of the standing pair.
        light: in which the port is.
        gloss: of the port's plastic, 0..1.
        style: dirt, drops, mirrored sky, shadow, exposure.
        seed: of lamps and noise.
    """

    place: str
    light: Light
    gloss: float
    style: Style
    seed: int

    def moved(self, cell: Workcell) -> Workcell:
        """A cell whose standing pair is at this place and looks at the packaged car's port."""
        position = PLACES[self.place]
        if position is None:
            return cell
        x, y, z = (float(v) for v in position)
        pairs = tuple(
            pair.model_copy(update={"position": (x, y, z)}) if pair.name == POST else pair
            for pair in cell.stereo
        )
        return cell.model_copy(update={"stereo": pairs})

    def glossy(self, spec: WorldSpec) -> WorldSpec:
        """A world whose port shines as its plastic does here."""
        socket = spec.socket
        assert socket is not None
        shine = tuple(
            replace(look, gloss=max(look.gloss, self.gloss))
            if look.material == "black_plastic"
            else look
            for look in socket.looks
        )
        return replace(spec, socket=replace(socket, looks=shine))

    def light_up(self, world: SimulatedWorld) -> None:
        """Each lamp by itself, so that shadows and shine come from anywhere."""
        rng = np.random.default_rng((self.seed, 1))
        lamps, around = self._lamps(world.lamps)
        sun = None
        if self.light == "low_sun" and world.car is not None:
            T = world.car.T_world_socket
            side, height = rng.uniform(-1.1, 1.1), rng.uniform(0.05, 0.35)
            out = np.arctan2(T[1, 2], T[0, 2]) + side
            direction = np.array([np.cos(out) * np.cos(height), np.sin(out) * np.cos(height), 0.0])
            direction[2] = np.sin(height)
            sun = (T[:3, 3] + SUN * direction, T[:3, 3])
        world.relight(lamps, around, sun)

    def _lamps(self, count: int = 3) -> tuple[Floats, float]:
        """Factors of each lamp's brightness, and of the light from everywhere."""
        rng = np.random.default_rng((self.seed, 3))
        lamps = BRIGHT[self.light] * rng.uniform(0.2, 1.8, count)
        if self.light == "low_sun":
            lamps[0] = rng.uniform(2.0, 3.3)
        return lamps, AROUND[self.light] * float(rng.uniform(0.4, 1.3))

    def over(self, frame: StereoFrame, info: StereoInfo, T_left_port: Pose) -> StereoFrame:
        """A pair's pictures with what weather and dirt make of them.

        Args:
            frame: as rendered.
            info: of the pair.
            T_left_port: the port in the left lens's frame, truly.
        """
        rng = np.random.default_rng((self.seed, 2, frame.sequence, info.name == POST))
        lamps, around = self._lamps()
        level = 0.5 * (around + float(lamps.mean()))  # dirt and sky are as bright as the light is
        pictures: list[ColorImage] = []
        for picture, lens, T in (
            (frame.left, info.left, np.eye(4)),
            (frame.right, info.right, info.lenses.T_left_right),
        ):
            grey = np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.float32)
            seen = weather(grey / np.float32(level), lens, inverse(T) @ T_left_port, self.style)
            shown = expose(seen * np.float32(level), self.style, rng)
            pictures.append(np.ascontiguousarray(np.dstack([shown] * 3)))
        return replace(frame, left=pictures[0], right=pictures[1])


def surroundings(rng: np.random.Generator) -> Surroundings:
    """Drawn at random; shares of wet, shadow, dirt and gloss as in `port-pose`."""
    place = tuple(PLACES)[int(rng.integers(len(PLACES)))]
    light = LIGHTS[int(rng.integers(len(LIGHTS)))]
    seed = int(rng.integers(2**31))
    gloss = float(rng.uniform(0.0, 0.7))
    wet = float(rng.uniform(0.3, 1.0)) if rng.random() < 0.25 else 0.0
    style = Style(
        gain=GAIN.get(light, 1.0) * float(rng.uniform(0.8, 1.3)),
        noise=0.5,  # beside what the rendered picture has
        blur=0.35,
        dirt=float(rng.uniform(0.0, 0.15)),
        wet=wet,
        mirror=float(rng.uniform(0.0, 14.0)) * (1.0 + wet) * gloss,
        shade=float(rng.uniform(0.35, 0.7)) if rng.random() < 0.3 else 1.0,
        seed=seed,
    )
    return Surroundings(place, light, gloss, style, seed)

"""Simulated cameras: what they see, and what is told of it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from armsight.arrays import Bytes, ColorImage, DepthImage, Pose, Vector3
from armsight.devices.data import RgbdCameraInfo, RgbdFrame, StereoFrame, StereoInfo
from armsight.errors import DeviceError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import make_pose
from armsight.simulation.camera_faults import Fault, Faults
from armsight.simulation.clock import SimulatedClock
from armsight.simulation.delivery import Deliveries, Delivery, Timing
from armsight.simulation.lies import LIES, Liar
from armsight.simulation.photographer import Photographer
from armsight.simulation.render_thread import RenderThread
from armsight.simulation.rendering import DepthPicture, Shot
from armsight.simulation.sensor_errors import DepthSensor, interference_mask, structured
from armsight.simulation.spec import CameraSpec
from armsight.simulation.units import draw_camera

_Develop = Callable[[], Bytes] | None
Frame = TypeVar("Frame", RgbdFrame, StereoFrame)


class SimulatedCamera:
    """Implements :class:`armsight.devices.protocols.RgbdCamera`.

    Attributes:
        faults: what goes wrong, see :class:`Fault`.
        unit: the truth about it; it moves when somebody bumps it (:meth:`bump`).
    """

    def __init__(
        self, spec: CameraSpec, clock: SimulatedClock, materials: Bytes, seed: tuple[int, ...]
    ) -> None:
        self._spec = spec
        self._number = seed[-1]
        self._timing = Timing(spec, clock, (*seed, 1))
        self.faults = self._timing.faults
        self.unit = draw_camera(spec, seed)
        self._put_up = self.unit.T_mount_camera
        truth = replace(spec.info, depth=self.unit.depth)
        self._sensor = (
            DepthSensor(truth, materials, (*seed, 3), unit=self.unit.errors)
            if spec.errors
            else None
        )
        self.disturbs = spec.errors and structured(spec.info)
        self.liar = Liar(spec.info.range[1], (*seed, 4))
        self.rivals: tuple[SimulatedCamera, ...] = ()
        self.photographer: Photographer | None = None
        self.reset()

    def reset(self) -> None:
        """Back to time 0, where it was put up; faults stay."""
        self.unit = replace(self.unit, T_mount_camera=self._put_up)
        self._timing.reset()
        self.liar.reset()
        self._deliveries = Deliveries()
        self._frozen: Future[Any] | None = None
        self._color_rate, self._color_scale = 0.0, 1.0
        self._color_due = -np.inf
        self._infrared_wanted = self._idle = False
        self.seen: tuple[DepthPicture, Pose] | None = None

    @property
    def info(self) -> RgbdCameraInfo:
        """What the cell believes of it."""
        return self._spec.info

    def read(self) -> RgbdFrame | None:
        """The newest frame that has arrived since the last call, or None.

        Raises:
            DeviceError: the camera is lost.
        """
        self._timing.check()
        found = self._deliveries.newest(self._timing.clock.now())
        if found is None:
            return None
        depth, color, infrared = found.picture.result()
        return RgbdFrame(
            self.info.name,
            found.sequence,
            found.stamp,
            found.arrival,
            depth,
            color,
            infrared=infrared,
        )

    def want_color(self, rate: float, scale: float = 1.0) -> None:
        """Ask for colour beside depth from the next exposure on; a rate of 0 spares it.

        Raises:
            DeviceError: the rate is below 0, or the scale not above 0 and at most 1.
        """
        if not (rate >= 0.0 and 0.0 < scale <= 1.0):
            raise DeviceError(
                f"camera '{self.info.name}': colour at {rate} Hz and scale {scale}; "
                "expected a rate of 0 or more and a scale above 0, at most 1"
            )
        self._color_rate, self._color_scale = rate, scale

    def _color_lens(self) -> PinholeCamera | None:
        """The true colour lens at the size that is wanted."""
        full, scale = self.unit.color, self._color_scale
        return full.scaled(scale) if full is not None and scale < 1.0 else full

    def want_infrared(self, wanted: bool) -> None:
        """Ask for the depth lens's own picture beside every colour picture, or spare it."""
        self._infrared_wanted = wanted

    def stand_by(self, idle: bool) -> None:
        """Take no picture while nobody looks, which spares drawing them."""
        self._idle = idle

    @property
    def T_mount_camera(self) -> Pose:
        """Where the depth lens truly is: in world when fixed, else in the flange."""
        return self.unit.T_mount_camera

    def bump(self, T_camera_moved: Pose) -> None:
        """Move it, as somebody who walks into its stand: the cell is not told.

        Args:
            T_camera_moved: where it is afterwards, in its own frame of before.
        """
        T = np.asarray(self.unit.T_mount_camera @ T_camera_moved)
        self.unit = replace(self.unit, T_mount_camera=T)

    def push(self, position: Vector3) -> None:
        """Move it to (3,) a place in its mount [m], turned as it is; the cell is not told."""
        T = make_pose(self.T_mount_camera[:3, :3], position)
        self.unit = replace(self.unit, T_mount_camera=T)

    # What the world does with it ---------------------------------------------------------------

    @property
    def next_exposure(self) -> float:
        """When the shutter opens next [s]."""
        return self._timing.next_exposure

    def expose(
        self, now: float, T_world_camera: Pose, take: Callable[..., Shot], renders: RenderThread
    ) -> None:
        """Open the shutter at ``now`` [s] from a true optical pose."""
        times = self._timing.expose(now)
        if times is None or self._idle:
            return
        sequence, stamp, arrival = times
        if self.faults.find("freeze", now) and self._frozen is not None:
            picture = self._frozen
        else:
            unit = self.unit
            shot = take(T_world_camera, unit.depth)
            pictures = self._pictures(T_world_camera, sequence, now)
            empty = self.faults.find("empty", now) is not None
            picture = renders.submit(
                lambda: self._develop(renders, shot, T_world_camera, sequence, now, pictures, empty)
            )
            self._frozen = picture
        keep = bool(self.rivals) or picture is self._frozen
        self._deliveries.add(Delivery(sequence, stamp, arrival, picture), now, cancel=not keep)

    def snap(
        self,
        T_world_camera: Pose,
        take: Callable[..., Shot],
        renders: RenderThread,
        sequence: int,
    ) -> RgbdFrame:
        """A frame of this very moment with both pictures, as if it had been wanted."""
        self._infrared_wanted, wanted = True, self._infrared_wanted
        pictures = self._shoot(T_world_camera, sequence)
        self._infrared_wanted = wanted
        shot, now = take(T_world_camera, self.unit.depth), self._timing.clock.now()
        depth, color, infrared = self._develop(
            renders, shot, T_world_camera, sequence, now, pictures, False
        )
        return RgbdFrame(self.info.name, sequence, now, now, depth, color, infrared=infrared)

    def _pictures(
        self, T_world_camera: Pose, sequence: int, now: float
    ) -> tuple[_Develop, _Develop]:
        """How the pictures of this instant are developed, if they are wanted and due."""
        if self._color_rate <= 0.0 or now < self._color_due - 1e-9:
            return None, None
        # From the time it was due, not from now: exposures do not fit the rate exactly.
        late = now - self._color_due < 1.0 / self._color_rate
        self._color_due = (self._color_due if late else now) + 1.0 / self._color_rate
        return self._shoot(T_world_camera, sequence)

    def _shoot(self, T_world_camera: Pose, sequence: int) -> tuple[_Develop, _Develop]:
        """How the colour picture of this instant is developed, and the infrared one if wanted."""
        unit, photographer, lens = self.unit, self.photographer, self._color_lens()
        if photographer is None:
            return None, None
        camera, noisy = (self.info.name, self._number), self._sensor is not None
        color = infrared = None
        if lens is not None:
            T = T_world_camera @ unit.T_depth_color
            color = photographer.shoot(camera, T, lens, "color", sequence, noisy)
        if self._infrared_wanted and self.info.infrared_scale > 0:
            lens = unit.infrared(self.info.infrared_scale)
            infrared = photographer.shoot(camera, T_world_camera, lens, "infrared", sequence, noisy)
        return color, infrared

    def _develop(
        self,
        renders: RenderThread,
        shot: Shot,
        T_world_camera: Pose,
        sequence: int,
        now: float,
        pictures: tuple[_Develop, _Develop],
        empty: bool,
    ) -> tuple[DepthImage, ColorImage | None, Bytes | None]:
        """Depth as the sensor gives it, and colour; runs in the render thread."""
        renderer, info, unit = renders.renderer, self.info, self.unit
        picture = renderer.depth(shot, unit.depth)
        self.seen = (picture, T_world_camera)
        renderer.give_back(shot)
        color, infrared = (None if develop is None else develop() for develop in pictures)
        if empty:
            depth = np.full_like(picture.depth, np.nan)
        elif self._sensor is None:
            depth = picture.depth
            near, far = info.range
            with np.errstate(invalid="ignore"):
                depth[(depth < near) | (depth > far)] = np.nan
        else:
            mask = self._interference(picture, T_world_camera)
            depth = self._sensor.measure(picture, sequence, now, mask)
        depth.flags.writeable = False
        depth = self._lie(depth, now)
        return depth, color, infrared

    def _lie(self, depth: DepthImage, now: float) -> DepthImage:
        """What is told of a picture; all of it, unless a lie is at work."""
        lies = [f for kind in LIES if (f := self.faults.find(kind, now)) is not None]
        self.liar.keep(depth, now, self.faults.memory)
        for lie in lies:
            depth = self.liar.tell(lie.kind, depth, now, lie.amount)  # type: ignore[arg-type]
            depth.flags.writeable = False
        return depth

    def _interference(self, picture: DepthPicture, T_world_camera: Pose) -> Any:
        mask = None
        for rival in self.rivals:
            if rival.seen is None:
                continue
            other, T_other = rival.seen
            found = interference_mask(
                picture.depth,
                self.unit.depth,
                T_world_camera,
                other.depth,
                rival.unit.depth,
                T_other,
            )
            mask = found if mask is None else mask | found
        return mask


class SimulatedStereo:
    """Implements :class:`armsight.devices.protocols.StereoCamera`: the pair's two colour pictures.

    Attributes:
        faults: what goes wrong, see :class:`Fault`.
        unit: the truth about it; its left lens is ``depth``, its right one ``color``.
    """

    def __init__(self, spec: CameraSpec, clock: SimulatedClock, seed: tuple[int, ...]) -> None:
        self._spec = spec
        self._timing = Timing(spec, clock, (*seed, 1))
        self.faults = self._timing.faults
        self.unit = draw_camera(spec, seed)
        info = spec.info
        assert info.color is not None
        self._info = StereoInfo(
            info.name,
            info.model,
            info.depth,
            info.color,
            info.T_depth_color,
            info.mounted_on,
            info.T_mount_camera,
            info.rate,
            info.latency,
            info.covariance,
        )
        self.reset()

    def reset(self) -> None:
        """Back to time 0; faults stay."""
        self._timing.reset()
        self._deliveries = Deliveries()
        self._wanted = False

    @property
    def info(self) -> StereoInfo:
        """What the cell believes of it."""
        return self._info

    @property
    def T_mount_camera(self) -> Pose:
        """Where the left lens truly is: in world when fixed, else in the flange."""
        return self.unit.T_mount_camera

    def want_pictures(self, wanted: bool) -> None:
        """Ask for pairs from the next exposure on, or spare them."""
        self._wanted = wanted

    def read(self) -> StereoFrame | None:
        """The newest pair that has arrived since the last call, or None.

        Raises:
            DeviceError: the pair is lost.
        """
        self._timing.check()
        found = self._deliveries.newest(self._timing.clock.now())
        if found is None:
            return None
        left, right = found.picture.result()
        return StereoFrame(self.info.name, found.sequence, found.stamp, found.arrival, left, right)

    @property
    def next_exposure(self) -> float:
        """When the shutter opens next [s]."""
        return self._timing.next_exposure

    def expose(
        self, now: float, T_world_camera: Pose, take: Callable[..., Shot], renders: RenderThread
    ) -> None:
        """Open both shutters at ``now`` [s]."""
        times = self._timing.expose(now)
        if times is None or not self._wanted:
            return
        shot = take(T_world_camera, self.unit.depth, "color")
        picture = renders.submit(lambda: self._develop(renders, shot, T_world_camera))
        self._deliveries.add(Delivery(*times, picture), now, cancel=True)

    def _develop(self, renders: RenderThread, shot: Shot, T: Pose) -> tuple[ColorImage, ColorImage]:
        unit = self.unit
        assert unit.color is not None
        left = renders.renderer.color(shot, unit.depth)
        renders.renderer.aim(shot, T @ unit.T_depth_color, unit.color)
        right = renders.renderer.color(shot, unit.color)
        renders.renderer.give_back(shot)
        return left, right


def make_rivals(cameras: tuple[SimulatedCamera, ...]) -> None:
    """Tell cameras of each other: structured light interferes, and who lies tells another's."""
    for camera, after in zip(cameras, (*cameras[1:], *cameras[:1])):
        camera.liar.neighbour = after.liar if after is not camera else None
    disturbing = [camera for camera in cameras if camera.disturbs]
    for camera in disturbing:
        camera.rivals = tuple(other for other in disturbing if other is not camera)


__all__ = ["Fault", "Faults", "SimulatedCamera", "SimulatedStereo", "make_rivals"]

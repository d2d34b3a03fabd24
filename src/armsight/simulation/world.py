"""The simulated cell: one object that owns physics, people, cameras and time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any

import numpy as np

from armsight.arrays import ColorImage, Floats, JointVector, Pose, Vector3
from armsight.devices.data import RgbdFrame
from armsight.devices.world import MovingSolid, MovingSurfaces
from armsight.errors import UsageError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, make_pose
from armsight.simulation.arm import SimulatedArm
from armsight.simulation.arm_errors import compliance, true_geometry
from armsight.simulation.board import draw_board
from armsight.simulation.cameras import SimulatedCamera, SimulatedStereo, make_rivals
from armsight.simulation.clock import SimulatedClock
from armsight.simulation.floating_tip import floating
from armsight.simulation.giving import Followers
from armsight.simulation.gl import mujoco
from armsight.simulation.gripper import SimulatedGripper
from armsight.simulation.lid_parts import LidParts
from armsight.simulation.looks import cloth_colors
from armsight.simulation.loose import LooseThings
from armsight.simulation.memory import Memory
from armsight.simulation.model import build_model
from armsight.simulation.movers import (
    Hand,
    MovingObject,
    Trajectory,
    drawn_bodies,
    drawn_solids,
    make_objects,
    make_people,
)
from armsight.simulation.parked_car import ParkedCar, port_surfaces
from armsight.simulation.photographer import Photographer
from armsight.simulation.plugs import Plugged
from armsight.simulation.render_thread import RenderThread
from armsight.simulation.rendering import Kind, Renderer, Shot
from armsight.simulation.scoring import camera_error
from armsight.simulation.spec import WorldSpec
from armsight.simulation.truth import Truth
from armsight.simulation.wrench import SimulatedWrench

MOVER_PERIOD = 0.004
"""Seconds between updates of people and objects [s]."""
TRUTH_PERIOD = 0.02
"""Seconds between measurements of the distance to people [s]."""


class SimulatedWorld:
    """The cell behind the simulated devices.

    Time moves in whole physics steps inside :meth:`advance`; exposures happen at the first step at
    or after their time and carry that step's stamp. Everything random follows ``seed``: two worlds
    of the same spec and seed that are commanded alike give the same bits.

    Attributes:
        clock, arm, cameras, stereo_cameras: the devices.
        board: the truth about the calibration board, or None.
        truth: what really happened, for experiments only.
        renderer: pictures from any pose (see also :meth:`picture`).
        plugged: the truth about a plug and its socket, or None.
        tip: a tool's tip that floats on springs, where contact pushes; or None.
        car: the car that the socket belongs to, or None; lid: the truth about its lid, or None.
        memory: where everything stands, for a program that takes over.
    """

    def __init__(self, spec: WorldSpec, seed: int = 0) -> None:
        self.spec = spec
        self.seed = seed
        self.clock = SimulatedClock()
        self._people = make_people(spec.people, spec.objects, spec.static)
        self._objects = make_objects(spec.objects, self._people, seed)
        self.car = None if spec.socket is None else ParkedCar(spec.socket, seed)
        cars = () if self.car is None else (self.car,)
        self._movers = {mover.name: mover for mover in (*self._people, *self._objects, *cars)}
        names = {*self._movers, *(item.solid.name for item in spec.objects)}
        if len(names) < len(spec.people) + len(spec.objects) + len(cars):
            raise UsageError("people, moving objects and the car need names of their own")
        robot, scale = spec.arm.robot, spec.arm.kinematic_error
        geometry = true_geometry(robot, scale, np.random.default_rng((seed, 10)))
        self.board = None if spec.board is None else draw_board(spec.board, seed)
        self._cell = build_model(spec, [p.body for p in self._people], geometry, self.board)
        self._data: Any = mujoco.MjData(self._cell.model)
        self._followers = Followers(self._cell.model, self._cell.movers.givers)
        self._loose = LooseThings(self._cell, [o for o in spec.objects if o.path == "loose"])
        self.plugged = (
            None
            if spec.plug is None
            else Plugged(self._cell.model, self._data, spec.plug, spec.socket)
        )
        self.tip = floating(self._cell.model, self._data, robot.tool)
        self._lid_parts = LidParts(self._cell.model, self._data, spec)
        self.lid = self._lid_parts.lid
        self.arm = SimulatedArm(
            spec.arm,
            self.clock,
            spec.time_step,
            seed,
            compliance(robot, scale, self._cell.greatest_load),
        )
        self.cameras = tuple(
            SimulatedCamera(camera, self.clock, self._cell.materials, (seed, 20 + i))
            for i, camera in enumerate(spec.cameras)
        )
        self._fixed = {c.info.name: c for c in self.cameras if c.info.mounted_on == "base"}
        make_rivals(self.cameras)
        self.stereo_cameras = tuple(
            SimulatedStereo(pair, self.clock, (seed, 40 + i)) for i, pair in enumerate(spec.stereo)
        )
        self.wrench = (
            None
            if spec.wrench is None
            else SimulatedWrench(spec.wrench, self.clock, spec.time_step, (seed, 30))
        )
        self.gripper = None if spec.gripper is None else SimulatedGripper(spec.gripper, self.clock)
        self.memory = Memory(
            self._cell.model, self._data, self.arm, self.car, self.lid, self.gripper
        )
        self._shutters: tuple[SimulatedCamera | SimulatedStereo, ...] = (
            *self.cameras,
            *self.stereo_cameras,
        )
        self.renderer = Renderer(self._cell)
        if spec.cameras or spec.stereo:
            self.renderer.open()
        self._renders = RenderThread(self.renderer)
        self._photographer = Photographer(
            self.renderer,
            self._data,
            spec.arm.robot.n,
            bool(self._movers),
            self.board,
            self._board_pose,
            seed,
        )
        for camera in self.cameras:
            camera.photographer = self._photographer
        self.truth = Truth(self._cell, spec.arm.robot, self._data)
        self._drawn = [drawn_solids(p.body, cloth_colors(p.name)) for p in self._people]
        self._looks = [drawn_bodies(p.body, cloth_colors(p.name)) for p in self._people]
        self._port = () if spec.socket is None else port_surfaces(spec.socket)
        self._mover_steps = max(1, round(MOVER_PERIOD / spec.time_step))
        self._truth_steps = max(1, round(TRUTH_PERIOD / spec.time_step))
        self.reset()

    def reset(self) -> None:
        """Back to time 0: the same run again, bit for bit."""
        mujoco.mj_resetData(self._cell.model, self._data)
        n = self.spec.arm.robot.n
        self._data.qpos[:n] = self.spec.arm.home
        self._data.ctrl[:n] = self.spec.arm.home
        self._step = 0
        self.clock._set(0.0)
        self.arm.reset()
        for mover in self._movers.values():
            mover.reset()
        self._loose.reset()
        self._renders.finish()
        self._photographer.reset()
        for camera in self._shutters:
            camera.reset()
        for device in (self.wrench, self.gripper):
            if device is not None:
                device.reset()
        self._lid_parts.reset()
        if self.plugged is not None:
            self.plugged.reset()
        self.truth.reset()
        self._move_movers(0.0)
        self._followers.reset(self._data)
        mujoco.mj_forward(self._cell.model, self._data)

    def relight(
        self,
        lamps: Sequence[float] | Floats,
        around: float,
        first: tuple[Vector3, Vector3] | None = None,
    ) -> None:
        """Another light: times of day and weather. Depth and contact do not change.

        Args:
            lamps: (L,) factors of the brightness of each lamp (``simulation/looks.py``).
            around: factor of the light that comes from everywhere.
            first: where the first lamp, which casts shadows, stands, and what it is turned to, in
                world [m]; None leaves it.

        Raises:
            ValueError: not as many factors as lamps.
        """
        model, shown = self._cell.model, self._cell.model.vis.headlight
        if len(lamps) != model.nlight:
            raise ValueError(f"{len(lamps)} factors of brightness for {model.nlight} lamps")
        for light in (model.light_diffuse, model.light_specular):
            light[:] *= np.asarray(lamps)[:, None]
        shown.ambient[:] *= around
        shown.diffuse[:] *= around
        if first is not None:
            model.light_pos[0], model.light_dir[0] = first[0], first[1] - first[0]
            model.light_dir[0] /= np.linalg.norm(model.light_dir[0])

    @property
    def lamps(self) -> int:
        """How many there are."""
        return int(self._cell.model.nlight)

    def advance(self, until: float) -> None:
        """Let time pass to ``until`` [s]: physics, exposures, deliveries."""
        dt = self.spec.time_step
        model, data, truth = self._cell.model, self._data, self.truth
        n = self.spec.arm.robot.n
        q, qd, control = data.qpos[:n], data.qvel[:n], data.ctrl[: 2 * n]
        drive, load = data.qfrc_actuator[:n], data.qfrc_gravcomp[:n]
        step, last = self._step, int(np.floor(until / dt + 1e-6))
        while step <= last:
            now = step * dt
            if step % self._mover_steps == 0:
                self._move_movers(now)
                if self.plugged is not None:
                    self.plugged.swing(now)
                self._followers.note(data, now, self._mover_steps * dt)
            self._expose(now)
            if step == last:
                break
            self.arm.before_step(now, q, control)
            if self.spec.pushes:
                self._push(now)
            if self.plugged is not None:
                self.plugged.push()
                self._lid_parts.push(self.gripper, now)
            if self.tip is not None:
                self.tip.push()
            before = None if self.wrench is None else data.qvel.copy()
            mujoco.mj_step(model, data)
            if data.ncon:
                truth.note_contacts(now, dt)
            if step % self._truth_steps == 0:
                truth.note_separation(now)
            step += 1
            self.arm.sense(step, step * dt, q, qd, drive, load)
            if self.wrench is not None:
                self._feel(self.wrench, step, before)
            if self._cell.fingers is not None and self.gripper is not None:
                at = self._cell.fingers[0]
                self.gripper.feel(float(data.qpos[at]), float(data.qvel[at]))
        self._step = step
        self.clock._set(max(until, self.clock.now()))

    def show_joints(self, position: JointVector) -> None:
        """Put the arm where a real one is, for cameras that are simulated beside it.

        Args:
            position: (n,) [rad].
        """
        n = self.spec.arm.robot.n
        self._data.qpos[:n] = position
        self._data.qvel[:n] = 0.0
        self.arm.reference_position = np.array(position, float)
        self.arm.reference_velocity = np.zeros(n)

    def movers(self) -> tuple[MovingSolid, ...]:
        """Every solid of people and moving objects where it is now, for drawing."""
        states = []
        for person, drawn in zip(self._people, self._drawn):
            poses = [self._pose(f"{person.name}/{part.name}") for part in person.body.parts]
            for index, solid in drawn:
                states.append(MovingSolid(solid.name, solid, poses[index] @ solid.T_frame_solid))
        for item in self.spec.objects:
            pose = self._pose(item.solid.name)
            if item.held_by:
                pose = pose @ item.solid.T_frame_solid
            states.append(MovingSolid(item.solid.name, item.solid, pose))
            for part in item.parts:
                states.append(MovingSolid(part.name, part, pose @ part.T_frame_solid))
        if self.car is not None and self.spec.socket is not None:
            T = self.car.T_world_socket
            for solid in self.spec.socket.solids:
                states.append(MovingSolid(solid.name, solid, T @ solid.T_frame_solid))
        cable = () if self.plugged is None else self.plugged.drawn()
        return (*states, *self._lid_parts.drawn(), *cable)

    def bodies(self) -> tuple[MovingSurfaces, ...]:
        """What people look like, part by part, where they are now, for drawing."""
        states = []
        for looks in self._looks:
            for name, surfaces in looks:
                states.append(MovingSurfaces(name, surfaces, self._pose(name)))
        if self.car is not None:
            states.append(MovingSurfaces("port/looks", self._port, self.car.T_world_socket))
        return tuple(states)

    def drag(self, name: str, position_world: Vector3 | None) -> None:
        """Lead an object, a lone hand or a person's right hand to a point of the world [m].

        It goes there at its own greatest speed. None lets it go. A fixed camera is there at once,
        turned as it was: its stand was pushed, and the cell is not told.

        Raises:
            UsageError: nothing of that name moves.
        """
        if name in self._loose:
            self._loose.drag(name, position_world)
        elif name in self._movers or name not in self._fixed:
            self._mover(name).drag(position_world)
        elif position_world is not None:
            self._fixed[name].push(position_world)

    def follow(self, name: str, trajectory: Trajectory | None) -> None:
        """Let a lone hand or an object follow a function of time, in trials; None ends it.

        Raises:
            UsageError: there is nothing of that name that could.
        """
        mover = self._mover(name)
        if not isinstance(mover, Hand | MovingObject):
            raise UsageError(
                f"'{name}' is neither a lone hand (motion = 'hand') nor an object on a path; only "
                "those follow"
            )
        mover.follow(trajectory)

    def camera_error(self, name: str, T_believed_corrected: Pose, gain: float) -> float | None:
        """How wrong the cell is about a camera, in its mount [m]; None for one that is not ours."""
        camera = next((c for c in self.cameras if c.info.name == name), None)
        if camera is None:
            return None
        info, T_true = camera.info, camera.T_mount_camera
        if info.mounted_on == "base":  # the truth about fixed cameras stands in world
            T_true = inverse(self.spec.arm.T_world_base) @ T_true
        T_believed = info.T_mount_camera @ T_believed_corrected
        return camera_error(info, T_believed, gain, camera.unit, T_true).pose

    def picture(self, T_world_camera: Pose, lens: PinholeCamera) -> ColorImage:
        """(h, w, 3) still of the cell as it is now, from any optical pose."""
        self._settle()
        shot = self.renderer.take(self._data, T_world_camera, lens, "still")
        image = self.renderer.color(shot, lens)
        self.renderer.give_back(shot)
        return image

    def place(self, joints: JointVector) -> None:
        """Put the arm at once where it reports (n,) joint angles [rad]; for pools of photographs.

        It sags as it would; the small error of every rest is left out.
        """
        n, data = self.spec.arm.robot.n, self._data
        data.qpos[:n] = joints
        mujoco.mj_forward(self._cell.model, data)
        data.qpos[:n] = joints - self.arm.compliance * data.qfrc_gravcomp[:n]
        self._settle()

    def snap(self, camera: int, sequence: int) -> RgbdFrame:
        """What a camera sees at this moment, in colour and infrared too, whatever its rate."""
        taker = self.cameras[camera]
        self._settle()
        return taker.snap(self._camera_pose(taker), self._taker(taker), self._renders, sequence)

    def close(self) -> None:
        """Give OpenGL's memory back; may be repeated."""
        self._renders.close()

    def __enter__(self) -> SimulatedWorld:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _feel(self, wrench: SimulatedWrench, step: int, before: Any) -> None:
        """Tell the force sensor what acts on the flange; MuJoCo gives what it acts with.

        The implicit integrator moves stiff joints with less than the acceleration of the forward
        dynamics; the sensor has to feel the one that really was.
        """
        assert self._cell.wrench is not None
        model, data = self._cell.model, self._data
        data.qacc[:] = (data.qvel - before) / self.spec.time_step
        mujoco.mj_rnePostConstraint(model, data)
        mujoco.mj_sensorAcc(model, data)
        force, torque = (data.sensordata[at : at + 3] for at in self._cell.wrench)
        wrench.sense(step, step * self.spec.time_step, -force, -torque)

    def _mover(self, name: str) -> Any:
        owner = name.split("/")[0]
        if owner not in self._movers:
            known = ", ".join([*sorted(self._movers), *self._fixed]) or "nothing at all"
            raise UsageError(f"nothing called '{owner}' moves in this cell; what moves: {known}")
        return self._movers[owner]

    def _pose(self, name: str) -> Pose:
        """Where a part of a person, or a thing, is: what is led stiffly is where its leader is."""
        body, data = self._cell.movers.shapes[name], self._data
        leader = int(self._cell.model.body_mocapid[body])
        if leader < 0:
            return make_pose(data.xmat[body].reshape(3, 3), data.xpos[body])
        # Called for every part of every person at every look: scipy's rotations would be felt.
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, data.mocap_quat[leader])
        return make_pose(rotation.reshape(3, 3), data.mocap_pos[leader])

    def _push(self, now: float) -> None:
        """What makes bodies follow their own motion, things be carried, and fingers close."""
        data = self._data
        self._followers.push(data, now)
        self._loose.push(data, self.spec.time_step)
        if self._cell.fingers is not None and self.gripper is not None:
            at = self._cell.fingers[1]
            data.ctrl[at : at + 2] = 0.5 * (self.gripper.opening - self.gripper.wanted(now))

    def _move_movers(self, now: float) -> None:
        positions, quaternions = self._data.mocap_pos, self._data.mocap_quat
        for person, first in zip(self._people, self._cell.person_bodies):
            to = first + len(person.body.parts)
            person.update(now, positions[first:to], quaternions[first:to])
        for item in self._objects:
            first = self._cell.movers.leaders[item.name]
            item.update(now, positions[first : first + 1], quaternions[first : first + 1])
        if self.car is not None:
            at = self._cell.socket
            self.car.update(now, positions[at : at + 1], quaternions[at : at + 1])

    def _settle(self) -> None:
        """Make everything's place agree with the joints and movers as they are now."""
        mujoco.mj_kinematics(self._cell.model, self._data)
        mujoco.mj_camlight(self._cell.model, self._data)

    def _expose(self, now: float) -> None:
        due = [c for c in self._shutters if c.next_exposure <= now + 1e-9]
        if not due:
            return
        self._move_movers(now)
        self._settle()
        for camera in due:
            camera.expose(now, self._camera_pose(camera), self._taker(camera), self._renders)

    def _taker(self, camera: SimulatedCamera | SimulatedStereo) -> Callable[..., Shot]:
        fixed = camera.info.mounted_on == "base"

        def take(T_world_camera: Pose, lens: PinholeCamera, kind: Kind = "depth") -> Shot:
            return self.renderer.take(self._data, T_world_camera, lens, kind, fixed)

        return take

    def _camera_pose(self, camera: SimulatedCamera | SimulatedStereo) -> Pose:
        """True optical pose of the depth lens in world."""
        if camera.info.mounted_on == "base":
            return camera.T_mount_camera
        return np.asarray(self._flange() @ camera.T_mount_camera)

    def _board_pose(self) -> Pose:
        """Where the board truly is, in world."""
        board = self.board
        assert board is not None
        if board.mounted_on == "world":
            return board.T_mount_board
        return np.asarray(self._flange() @ board.T_mount_board)

    def _flange(self) -> Pose:
        """``T_world_flange`` as it truly is, once everything has been settled."""
        last = int(self._cell.link_bodies[-1])
        T = np.eye(4)
        T[:3, :3] = self._data.xmat[last].reshape(3, 3)
        T[:3, 3] = self._data.xpos[last]
        return np.asarray(T @ self.spec.arm.robot.T_last_flange)

"""A station before a car in contact physics alone: no guard, no map.

Two hundred milliseconds of processor time a simulated second, so it serves the many visits, the
kill test and the station's own tests. Looks are drawn from their errors, or rendered and searched.
Motions to a pose are planned as in a session, round what is declared and round the car where its
port was found, and followed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import Floats, JointVector, Pose
from armsight.charging.admittance import Admittance
from armsight.charging.eye import PortLook
from armsight.charging.insert import InsertOptions
from armsight.charging.journal import Journal
from armsight.charging.lid_eye import LidLook
from armsight.charging.lid_finger import LidSetup
from armsight.charging.station import Station
from armsight.charging.vehicle import Vehicle
from armsight.charging.visit import Seen, StationOptions, aside_of
from armsight.devices.data import JointState, Wrench
from armsight.experiments.station_eyes import FLANGE, POST, DrawnEyes, Eyes, Mode, RenderedEyes
from armsight.experiments.station_ways import StationWays
from armsight.experiments.station_weather import Surroundings
from armsight.geometry.pose import inverse
from armsight.motion.data import GuardMode, GuardStatus
from armsight.motion.intents import Intent, JointIntent, PoseIntent, VelocityIntent
from armsight.motion.permits import Permit, PermitState
from armsight.motion.steering import joints_of_twist
from armsight.motion.trajectory import Trajectory
from armsight.robots.kinematics import tcp_jacobian, tcp_pose
from armsight.simulation.plugs import Caught, Plugged
from armsight.simulation.world import SimulatedWorld
from armsight.tasks.parked_car import ParkedCarOnMap, where_parked
from armsight.workcell import robot_in, world_spec
from armsight.workcell.car import finger_pose, vehicle_of
from armsight.workcell.packaged import load
from armsight.workcell.schema import Workcell

TICK = 0.008
"""Between two commands [s]."""
CAUGHT = 0.3
"""How far from the plug its cable is caught [m]."""
RESTS = 2e-3
"""A joint slower than this rests [rad/s]."""
RISE = 4.8
"""Greatest acceleration of a joint [rad/s^2]."""


@dataclass(frozen=True)
class Peaks:
    """Greatest true force of the socket on the plug [N].

    Attributes:
        axial: along the port's axis; lateral: across it; pull: what held it as it was pulled.
    """

    axial: float = 0.0
    lateral: float = 0.0
    pull: float = 0.0

    def with_force(self, plugged: Plugged) -> Peaks:
        """These, and what the socket does to the plug now."""
        force = plugged.T_world_socket[:3, :3].T @ plugged.wrench()[:3]
        return Peaks(
            max(self.axial, abs(float(force[2]))),
            max(self.lateral, float(np.hypot(*force[:2]))),
            max(self.pull, -float(force[2])),
        )


def depth_and_tilt(plugged: Plugged) -> tuple[float, float]:
    """True depth of the plug's front below the face [m] and its tilt [rad]."""
    T = plugged.T_socket_plug
    return float(-T[2, 3]), float(np.arccos(np.clip(-T[2, 2], -1.0, 1.0)))


class StationBench:
    """Runs a station; the truth is for the scoring only.

    Args:
        workcell: of the station and the car.
        seed: of sensor and looks.
        rendered: whether the pairs' pictures are rendered and searched; else looks are drawn.
        mode: of the station that looks at them.
        around: light, dirt and wet about the port; None: as the cell's file has it.

    Attributes:
        peaks: greatest forces so far.
        looks: newest of each pair; lids: likewise of the lid.
        car: what the map counts of the car; ways: round it.
        withdrawn: why the guard withdraws the permit, in words; empty while it grants it.
        numb: the force sensor says nothing any more.
        bias: (6,) that the force sensor says too much [N], [N m].
        possible: whether a port can be at a pose in ``base``, by the station.
    """

    def __init__(
        self,
        workcell: Workcell,
        seed: int = 0,
        rendered: bool = False,
        mode: Mode = "ours",
        around: Surroundings | None = None,
    ):
        self.workcell = workcell
        self.robot = robot_in(workcell)
        spec = replace(world_spec(workcell), cameras=())
        spec = spec if around is None else around.glossy(spec)
        self.world = SimulatedWorld(spec if rendered else replace(spec, stereo=()), seed)
        car, plug = workcell.simulation.car, workcell.plug
        assert car is not None
        assert plug is not None
        vehicle = vehicle_of(workcell, plug.vehicle)
        lid = None if vehicle is None else vehicle.lid
        T_port_lid = None if lid is None or vehicle is None else vehicle.T_port_lid
        self.possible: Callable[[Pose], bool] = lambda T_base_port: True
        self._eyes: Eyes = DrawnEyes(car.port, seed, T_port_lid, self._lid_shut, plug.kind)
        if rendered:
            where = where_parked(plug, workcell.robot.T_world_base, lambda T: self.possible(T))
            self._eyes = RenderedEyes(self.world, self.robot, plug.kind, mode, lid, around, where)
        if around is not None:
            around.light_up(self.world)
        self._status = _status("", False, None)
        self._wrench: Wrench | None = None
        self._joints: JointState | None = None
        self._T_base_world = inverse(workcell.robot.T_world_base)
        known = None if mode == "paper" else vehicle  # the paper's station knows no car
        self.car = ParkedCarOnMap(known, workcell.robot.T_world_base)
        self.ways = StationWays(workcell, self.robot, self.car, seed)
        self._goal, self._reason = "", ""
        self._motion: Trajectory | None = None
        self._began, self._again = 0.0, 0.0
        self._speed = np.zeros(self.robot.n)
        self.looks: dict[str, PortLook] = {}
        self.lids: dict[str, LidLook] = {}
        self._width: float | None = None
        self.peaks = Peaks()
        self.withdrawn = ""
        self.numb = False
        self.bias = np.zeros(6)

    @property
    def now(self) -> float:
        """[s]."""
        return float(self.world.clock.now())

    @property
    def T_base_port(self) -> Pose:
        """The truth, now."""
        assert self.world.car is not None
        return np.asarray(self._T_base_world @ self.world.car.T_world_socket)

    def step(self, station: Station) -> None:
        """One tick."""
        world = self.world
        while (reading := world.wrench.read() if world.wrench else None) is not None:
            self._wrench = self._wrench if self.numb else self._biased(reading)
        joints = world.arm.read() or self._joints
        if joints is not None:
            self._joints = joints
            hand = world.gripper
            seen = Seen(
                self.now,
                joints,
                self._wrench,
                self._status,
                tuple(self.looks.values()),
                tuple(self.lids.values()),
                None if hand is None else hand.wanted(self.now),
            )
            wish = station.step(seen)
            if station.port is not None:
                self.ways.found(station.port, station.lid_open)
            self._eyes.expect(station.expected_lid, station.expected_port)
            self._eyes.show(station.shown)
            for look in self._eyes.look(self.now, joints, wish.pairs, self.T_base_port):
                if isinstance(look, LidLook):
                    self.lids[look.pair] = look
                else:
                    self.looks[look.pair] = look
            width = getattr(wish.intent, "width", None)
            if hand is not None and width is not None and width != self._width:
                self._width = width
                hand.move(width)
            world.arm.command_velocity(self._follow(wish.intent, joints))
        world.advance(self.now + TICK)
        assert world.plugged is not None
        self.peaks = self.peaks.with_force(world.plugged)

    def run(self, station: Station, seconds: float = 120.0) -> bool:
        """Go on until no visit is under way; whether that came within some seconds [s]."""
        end = self.now + seconds
        while self.now < end:
            self.step(station)
            if not station.busy:
                return True
        return False

    def stop(self) -> None:
        """The arm's watchdog stops it: nobody commands any more. Nothing is asked or granted."""
        self._goal, self._speed = "", np.zeros(self.robot.n)
        self._status = _status("", False, None)
        end = self.now + 0.4
        self.world.arm.stop()
        while self.now < end:
            self.world.advance(self.now + TICK)

    def catch_cable(self, slack: float) -> None:
        """The plug's cable is caught below and behind it; so much of it is left [m]."""
        plugged = self.world.plugged
        assert plugged is not None
        end = plugged.cable_end
        away = plugged.T_world_socket[:3, 2] - np.array([0.0, 0.0, 0.5])
        plugged.caught = Caught(end + CAUGHT * away / float(np.linalg.norm(away)), CAUGHT + slack)

    def score(self) -> tuple[float, float]:
        """See :func:`depth_and_tilt`."""
        assert self.world.plugged is not None
        return depth_and_tilt(self.world.plugged)

    def _biased(self, told: Wrench) -> Wrench:
        force, torque = told.force + self.bias[:3], told.torque + self.bias[3:]
        return replace(told, force=force, torque=torque)

    def _lid_shut(self) -> bool:
        return self.world.lid is not None and self.world.lid.shut

    def _pressed(self) -> float:
        """How hard the socket presses the plug [N], as a guard with a force sensor would say."""
        plugged = self.world.plugged
        assert plugged is not None
        return float(np.linalg.norm(plugged.wrench()[:3]))

    def _follow(self, intent: Intent | None, joints: JointState) -> JointVector:
        q, robot = joints.position, self.robot
        permit = None if intent is None else intent.permit
        state = PermitState.WITHDRAWN if self.withdrawn else PermitState.GRANTED
        given = None
        if permit is not None:
            given = Permit(
                permit.name, permit.kind, state, self.withdrawn, permit.region,
                force=permit.force, pressed=self._pressed() if self.withdrawn else 0.0,
            )  # fmt: skip
        wanted, name, reached = np.zeros(robot.n), "", False
        if isinstance(intent, JointIntent | PoseIntent):
            name = intent.name
            if name != self._goal:
                self._goal, self._motion, self._again = name, None, 0.0
            if self._motion is None:
                self._plan(intent, joints)
            if self._motion is not None:
                since, away = self.now - self._began, self._motion.end - q
                ends = since >= self._motion.duration
                wanted = np.clip(2.5 * away, -0.1, 0.1) if ends else self._motion.velocity(since)
                reached = bool(ends and np.abs(away).max() < 1e-3)
        elif isinstance(intent, VelocityIntent):
            self._goal = ""
            velocity: Floats = intent.velocity
            if intent.frame == "tcp":
                R = tcp_pose(robot, q)[:3, :3]
                velocity = np.concatenate([R @ velocity[:3], R @ velocity[3:]])
            wanted = joints_of_twist(tcp_jacobian(robot, q), velocity)
        else:
            self._goal = ""  # after a rest a way is planned anew
        step = np.clip(wanted - self._speed, -RISE * TICK, RISE * TICK)
        self._speed = self._speed + step
        self._status = _status(name, reached, given, self._reason)
        return self._speed

    def _plan(self, intent: JointIntent | PoseIntent, joints: JointState) -> None:
        """Once the arm rests, and every half second until there is a way."""
        if self.now < self._again or np.abs([joints.velocity, self._speed]).max() > RESTS:
            return
        plan = self.ways.plan(intent, joints.position, granted=not self.withdrawn)
        self._motion, self._reason = plan.trajectory, plan.failure
        self._began, self._again = self.now, self.now + 0.5


def _status(goal: str, reached: bool, permit: Permit | None, reason: str = "") -> GuardStatus:
    nothing: Any = None
    return GuardStatus(
        0.0, GuardMode.PREDICTIVE, reason, goal, reached, np.zeros(6), 1.0, np.inf, 0.0, nothing,
        nothing, nothing, nothing, 0, 0.0, permit=permit,
    )  # fmt: skip


def parked(
    workcell: Workcell, position: tuple[float, float, float], yaw_deg: float, **car: Any
) -> Workcell:
    """A cell whose car is parked elsewhere, its flank with it."""
    old = workcell.simulation.car
    assert old is not None
    new = old.model_copy(update={"position": position, "yaw_deg": yaw_deg, **car})
    simulation = workcell.simulation.model_copy(update={"car": new})
    return workcell.model_copy(update={"simulation": simulation})


CELLS = {"type1": "ur10_charging_type1", "type2": "ur10_charging", "ccs2": "ur10_charging_ccs2"}
"""The packaged cell for each inlet."""


def charging_cell(port: str = "type2") -> Workcell:
    """The packaged cell for an inlet."""
    return load(CELLS[port])


def make_station(
    bench: StationBench,
    file: Path | None,
    car: Vehicle,
    mode: Mode = "ours",
    second_look: bool = True,
    shows: Sequence[JointVector] = (),
) -> Station:
    """A station of the bench's cell; without a second look it goes in by the standing pair's.

    It shows its plug at some (n,) joints [rad], if somebody asks for that.
    """
    cell, plug = bench.workcell, bench.workcell.plug
    assert plug is not None
    pairs = {p.name: p.T_mount_camera for p in cell.stereo}
    near = pairs[FLANGE] if second_look else None
    mount = Admittance((1e3 * plug.mount_n_per_mm, plug.mount_nm_per_rad), 0.074)
    law = InsertOptions(admittance=mount, port_depth=0.002)
    seen_near = FLANGE if second_look else ""
    vehicle, T_finger, lid = vehicle_of(cell, plug.vehicle), finger_pose(plug), None
    aside = aside_of(T_finger)
    options = StationOptions(plug.kind, mode, law, POST, seen_near, cable=plug.cable_n, aside=aside)
    if vehicle is not None and vehicle.lid is not None and T_finger is not None:
        assert cell.gripper is not None
        lid = LidSetup(vehicle, T_finger, cell.gripper.opening)
    contradiction = bench.car.contradiction
    journal, home = Journal(file), bench.robot.home
    station = Station(
        bench.robot, home, car, journal, options, near, contradiction, lid, shows=lambda: shows
    )
    bench.possible = station.possible
    return station

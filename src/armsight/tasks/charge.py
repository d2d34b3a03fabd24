"""T3's task: find a parked car's charging port, plug in, charge, unplug, stand by."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from armsight.charging.admittance import Admittance
from armsight.charging.eye import PortEye, PortLook, SeenPort
from armsight.charging.find import INLETS
from armsight.charging.insert import InsertOptions
from armsight.charging.journal import Journal
from armsight.charging.lid_eye import LidEye, LidLook
from armsight.charging.lid_finger import LidSetup
from armsight.charging.looking import INLETS_OF
from armsight.charging.moves import before_port
from armsight.charging.residual import PairsApart
from armsight.charging.stale import Cause, Stale
from armsight.charging.station import Station
from armsight.charging.vehicle import SimulatedCar, Vehicle
from armsight.charging.visit import PLUGGED, Seen, State, StationOptions, aside_of
from armsight.errors import UsageError
from armsight.geometry.shapes import Solid
from armsight.motion.face import (
    Button,
    Curve,
    EllipsoidMark,
    Face,
    Figure,
    FrameMark,
    Mark,
    Picture,
    RegionMark,
)
from armsight.motion.intents import Intent, Rest
from armsight.motion.task import Observation, Subscriptions
from armsight.robots.kinematics import tcp_pose
from armsight.tasks.parked_car import ParkedCarOnMap, where_parked
from armsight.tasks.plug_places import PlugPlaces
from armsight.tasks.vehicles import open_vehicle
from armsight.workcell.car import check_tool, finger_pose, vehicle_of
from armsight.workcell.drivers import SIMULATED

if TYPE_CHECKING:
    from armsight.workcell import Cell

Mode = Literal["ours", "paper"]
PORT_DEPTH = 0.002
"""How far the port's face may be from where a second look has it: two standard deviations [m]."""
SENSOR, TICK = 0.006, 0.008
"""From a force to its reading, and between two commands [s]."""
BEYOND = 0.05
"""A port this much farther from the base than the arm's maker says it reaches is tried [m]."""


@dataclass(frozen=True)
class ChargeOptions:
    """Plug a parked car in, charge it, unplug (T3).

    Attributes:
        inlet: what the car has; `auto` looks.
        mode: `ours`; `paper`: one look, a plane through the contacts, halted by force.
        visits: how many; each begins when the one before has ended. 0: by the page's button.
        charging: how long a simulated car charges [s].
        state: file in which the station keeps what it needs to come out again; CELL.station.json
            in the working folder if left out.
        show_plug: show the plug to the standing pair first: is it the one that was calibrated?
    """

    inlet: Literal["auto", "type1", "type2", "ccs1", "ccs2"] = "auto"
    mode: Mode = "ours"
    visits: int = 1
    charging: float = 5.0
    state: Path | None = None
    show_plug: bool = False

    def make(self, cell: Cell) -> ChargeTask:
        """The task for a cell.

        Raises:
            UsageError: the cell has no plug, no force sensor or no pair that stands still, or its
                car is not one for its plug, or has a lid that no pair could look at.
            TaskError: who speaks for the car cannot be loaded or opened.
            JournalError: what a killed station has left cannot be believed.
        """
        workcell = cell.workcell
        section = workcell.plug
        if section is None or cell.robot.tool is None or cell.wrench is None:
            raise UsageError(
                f"{workcell.name}: charging needs a [plug], a [wrench] and robot.tool in its file"
            )
        fixed = [p.info.name for p in cell.stereo if p.info.mounted_on == "base"]
        carried = [p.info for p in cell.stereo if p.info.mounted_on == "flange"]
        if not fixed:
            raise UsageError(f"{workcell.name}: no stereo pair that stands still looks for ports")
        if section.kind not in INLETS_OF:
            raise UsageError(f"{workcell.name}: plug.kind: no inlet for a {section.kind} is known")
        check_tool(workcell)
        fits = INLETS_OF[section.kind]
        looked_for = INLETS if self.inlet == "auto" else (self.inlet,)
        mount = Admittance(
            (1e3 * section.mount_n_per_mm, section.mount_nm_per_rad),
            workcell.robot.start_delay_ms / 1e3 + SENSOR + TICK,
        )
        vehicle = vehicle_of(workcell, section.vehicle)
        if vehicle is not None and vehicle.inlet not in fits:
            raise UsageError(
                f"{workcell.name}: plug.vehicle: {section.vehicle} has {vehicle.inlet}, which a "
                f"{section.kind} does not enter"
            )
        T_finger = finger_pose(section)
        aside = aside_of(T_finger)
        body = ParkedCarOnMap(vehicle, cell.T_world_base, aside)
        lid = None
        has_lid = vehicle is not None and vehicle.lid is not None and self.mode == "ours"
        if has_lid and T_finger is not None and cell.gripper is not None:
            assert vehicle is not None
            if not carried:
                raise UsageError(
                    f"{workcell.name}: a lid needs a stereo pair on the flange: from afar alone "
                    "no finger meets it"
                )
            lid = LidSetup(vehicle, T_finger, cell.gripper.opening)
        options = StationOptions(
            section.kind,
            self.mode,
            InsertOptions(admittance=mount, port_depth=PORT_DEPTH),
            fixed[0],
            carried[0].name if carried else "",
            cable=section.cable_n,
            aside=aside,
            reach=cell.robot.reach + BEYOND,
        )
        far = next(p.info for p in cell.stereo if p.info.name == fixed[0])
        places = PlugPlaces(cell.robot, far.lenses, far.T_mount_camera, section.kind)
        station = Station(
            cell.robot,
            cell.robot.home,
            self.speaker(cell),
            Journal(self.state or Path.cwd() / f"{workcell.name}.station.json"),
            options,
            carried[0].T_mount_camera if carried else None,
            body.contradiction,
            lid,
            () if vehicle is None else vehicle.solids,
            places,
        )
        if self.show_plug:
            station.check.ask()
        paper = self.mode == "paper"
        # under a lid that is shut there is no port to be looked for more closely
        where = (
            None
            if paper or lid is not None
            else where_parked(section, cell.T_world_base, station.possible)
        )
        eyes: list[PortEye | LidEye] = [PortEye(fixed[0], looked_for, paper=paper, where=where)]
        if carried and self.mode == "ours":
            eyes.append(PortEye(carried[0].name, fits, (0.15, 0.8)))
        if lid is not None and lid.shape.lid is not None:
            pairs = [fixed[0], *(info.name for info in carried)]
            eyes += [LidEye(pair, lid.shape.lid) for pair in pairs]
        return ChargeTask(station, eyes, self.visits, body, places, workcell.name)

    def speaker(self, cell: Cell) -> Vehicle:
        """Who speaks for the car.

        Raises:
            UsageError: nobody does, and the arm is a real one.
            TaskError: who should cannot be loaded or opened.
        """
        section = cell.workcell.plug
        if section is not None and section.car:
            return open_vehicle(section.car, section.connection)
        if cell.workcell.robot.driver != SIMULATED:
            raise UsageError(
                f"{cell.workcell.name}: nobody speaks for the car; name who does as plug.car. A "
                "simulated car says that it stands and has enough, whatever a real one does"
            )
        simulated = getattr(cell.world, "car", None)
        return SimulatedCar(
            "" if self.inlet == "auto" else self.inlet,
            self.charging,
            stands=lambda: simulated is None or simulated.parked,
        )


class ChargeTask:
    """Runs a station in a cell.

    Args:
        station: that decides.
        eyes: the perceivers; visits: to begin by itself.
        body: says to the cell what the parked car is.
        places: where the plug is shown; told what the map knows.
        cell: its name, for what is said.

    Attributes:
        apart: whether both pairs see the ports in one place.
        stale: asked between visits; None: nobody would calibrate. stale_by: why no next visit
            begins before pair and plug are calibrated again, or None.
        done: told once all visits that were asked for have ended.
        park: parks a simulated car anew; None where that cannot be.
    """

    name = "charge"
    period = 0.008
    latency = 0.002

    def __init__(
        self,
        station: Station,
        eyes: list[PortEye | LidEye],
        visits: int,
        body: ParkedCarOnMap,
        places: PlugPlaces | None = None,
        cell: str = "CELL",
    ) -> None:
        self.station, self.visits, self.body = station, visits, body
        self._places = places
        self.park: Callable[[], None] | None = None
        self.stale: Stale | None = None
        self.stale_by: Cause | None = None
        self.apart = PairsApart(station.options.far, station.options.near, cell)
        self.perceivers = tuple(eyes)
        self._perceivers = tuple(eye.name for eye in eyes)
        self._lid_eyes = tuple(eye for eye in eyes if isinstance(eye, LidEye))
        self._port_eyes = tuple(eye for eye in eyes if isinstance(eye, PortEye))
        self.done: Callable[[], None] = lambda: None
        self._fresh()

    @property
    def subscriptions(self) -> Subscriptions:
        """The looks, and the pair whose pictures are wanted now."""
        return Subscriptions(stereo=self._pairs, perceivers=self._perceivers, snapshot=True)

    @property
    def standing(self) -> Mapping[str, tuple[Solid, ...]]:
        """The car's body, where its port was found."""
        return self.body.standing

    @property
    def vehicle(self) -> Vehicle:
        """The car."""
        return self.station.vehicle

    def reset(self) -> None:
        """A simulated cell begins anew."""
        self.station.reset()
        self.body.gone()
        self._fresh()

    def _fresh(self) -> None:
        self._pairs: tuple[str, ...] = ()
        self._begun = 0
        self._left: SeenPort | None = None
        self._looks: dict[str, PortLook] = {}
        self._lids: dict[str, LidLook] = {}
        self._face = Face("wait")
        self._objection = ""

    def press(self, button: str) -> None:
        """A button of the page."""
        if button == "charge":
            self.station.begin()
        elif button == "end":
            self.station.end()
        elif button == "believe":
            self.station.check.believe()
        elif button == "park" and self.park is not None:
            self.park()

    def update(self, observation: Observation) -> Intent:
        """See :class:`~armsight.motion.task.Task`."""
        station = self.station
        for perceived in observation.perceived:
            if isinstance(perceived.evidence, PortLook):
                self._looks[perceived.evidence.pair] = perceived.evidence
                self.apart.take(perceived.evidence)
            elif isinstance(perceived.evidence, LidLook):
                self._lids[perceived.evidence.pair] = perceived.evidence
        joints = observation.joints
        if joints is None:
            return Rest("no joint reading yet")
        self._begun = max(self._begun, len(station.outcomes))  # one that a killed station left
        if not station.busy and self._begun < self.visits and self.stale_by is None:
            self._begun += 1
            station.begin()
        seen = Seen(
            observation.now,
            joints,
            observation.wrench,
            observation.guard,
            tuple(self._looks.values()),
            tuple(self._lids.values()),
            None if observation.gripper is None else observation.gripper.width,
        )
        wish = station.step(seen)
        self.stale_by = None if self.stale is None else self.stale.cause(observation.now)
        for eye in self._lid_eyes:
            eye.expected = station.expected_lid
        for looking in self._port_eyes:
            looking.shown, looking.expected = station.shown, station.expected_port
        self._on_map(observation)
        self._pairs = wish.pairs
        self._face = self._show(observation)
        if 0 < self.visits <= len(station.outcomes) and not station.busy:
            self.done()
        return wish.intent

    def _on_map(self, observation: Observation) -> None:
        """What the map has to know of the car."""
        car = self.vehicle.status(observation.now)
        if car is not None and not car.parked and self.station.state not in PLUGGED:
            self.body.gone()
            if not self.station.busy:
                self._left = self.station.port  # the next one stands elsewhere
        elif self.station.port is not None and self.station.port is not self._left:
            self.body.found(self.station.port.T_base_port, self.station.port.covariance)
            self.body.lid(self.station.port.T_base_port if self.station.lid_open else None)
        self._objection = self.body.told(observation.snapshot)
        if self._places is not None:
            self._places.snapshot = observation.snapshot if self.body.counts else None

    def face(self) -> Face:
        """What the page shows."""
        return self._face

    def _pictures(self) -> tuple[Picture, ...]:
        """Of each pair the newest that shows something; else the newest."""
        out = []
        for pair, look in sorted(self._looks.items()):
            lid = self._lids.get(pair)
            shown = lid is not None and lid.T_base_lid is not None and not look.ports
            out.append(Picture(pair, lid.picture if shown and lid is not None else look.picture))
        return tuple(out)

    def _show(self, observation: Observation) -> Face:
        station = self.station
        port, answer, outcome = station.port, station.answer, station.outcome
        marks: list[Mark] = []
        if port is not None:
            T = port.T_base_port
            marks.append(FrameMark("port", T, 0.08))
            covariance = T[:3, :3] @ station.port_covariance[:3, :3] @ T[:3, :3].T
            marks.append(EllipsoidMark.of("port sigma", T[:3, 3], covariance, 3.0))
            side = 2.0 * station.options.aside
            marks.append(RegionMark("may be touched", T, np.full(3, side)))
            marks.append(FrameMark("plug goal", before_port(T, 0.0), 0.05))
            if station.finger is not None and station.finger.T_base_lid is not None:
                marks.append(FrameMark("lid", station.finger.T_base_lid, 0.08))
        if observation.joints is not None:
            tip = tcp_pose(observation.robot, observation.joints.position)
            marks.append(FrameMark("plug", tip, 0.05))
        felt = station.feeling.contact(observation.now)
        pressed = float("nan") if felt is None else float(-felt[2])
        aside = float("nan") if felt is None else float(np.hypot(felt[0], felt[1]))
        in_law = station.state in (State.INSERT, State.UNPLUG)
        depth = 1e3 * answer.depth if answer is not None and in_law else math.nan
        six = station.port_covariance
        sigma = 1e3 * float(np.sqrt(np.diag(six)[:3].max())) if port else math.nan
        free, stuck = not station.busy, station.state is State.STUCK
        parking = () if self.park is None else (Button("park", "Park the car anew", free),)
        told = outcome.problem or outcome.warning
        doubted = (Button("believe", "The plug is right"),) if station.check.doubt else ()
        good = sum(o.seated and o.out and not o.problem for o in station.outcomes)
        return Face(
            state=station.state.value,
            reason=self._objection or station.words or told or self.apart.words,
            figures=(
                Figure("visits", float(len(station.outcomes))),
                Figure("without a fault", float(good)),
                Figure("port score", 100 * port.score if port else math.nan, "%"),
                Figure("port sigma", sigma, "mm"),
                Figure("tries", float(outcome.tries)),
                Figure("seated after", outcome.plugged - outcome.began, "s"),
            ),
            curves=(
                Curve("along", pressed, "N"),
                Curve("across", aside, "N"),
                Curve("depth", depth, "mm"),
            ),
            pictures=self._pictures(),
            marks=tuple(marks),
            buttons=(
                Button("charge", "Charge the car", not station.busy),
                Button("end", "End and come out", station.busy and not stuck),
                *doubted,
                *parking,
            ),
        )


__all__ = ["ChargeOptions", "ChargeTask", "Mode"]

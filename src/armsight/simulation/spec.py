"""What a simulated cell consists of: plain data, made from a workcell file or by hand.

Everything here is in the ``world`` frame of the cell: z up, floor at z = 0 unless said otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from armsight.arrays import Bytes, Floats, Ints, JointVector, Points, Pose, Vector3
from armsight.devices.data import RgbdCameraInfo
from armsight.geometry.shapes import Solid
from armsight.robots.cable import ROOT
from armsight.robots.robot import Robot

Latch = Literal["push", "spring"]
"""How a charging lid is held shut."""


@dataclass(frozen=True)
class ArmSpec:
    """The simulated arm.

    Attributes:
        robot: which, with its tool.
        T_world_base: where it is mounted (table, inverted ...).
        home: (n,) configuration at the start [rad].
        start_delay: command to first motion [s] (T2: 50-70 ms).
        state_latency: joint reading to arrival [s]; state_rate: readings a second [Hz].
        watchdog: stops by itself when no command came for this long [s].
        speed, acceleration: share of the limits that the controller allows, 0..1.
        repeatability: standard deviation of the tip [m].
        kinematic_error: scale of absolute errors (design calibration 4); 0 is an exact arm.
    """

    robot: Robot
    T_world_base: Pose
    home: JointVector
    start_delay: float = 0.06
    state_latency: float = 0.002
    state_rate: float = 500.0
    watchdog: float = 0.1
    speed: float = 0.5
    acceleration: float = 0.6
    repeatability: float = 0.0001
    kinematic_error: float = 0.0


@dataclass(frozen=True)
class CameraSpec:
    """A simulated depth camera.

    Attributes:
        info: what the cell *believes* of it, by its calibration file where there is one.
        T_mount_camera_declared: where the cell's file puts it, in world for a fixed camera, else in
            the flange; the truth is drawn around it (see ``units``).
        declared: what the cell's file alone says of it, the rest of what the truth is drawn around;
            ``info`` if absent.
        errors: whether the sensor's error model is on; ideal otherwise.
        pose_error: how far the truth is from the declared pose: (sigma [m], sigma [rad]).
        lens_error: scale of the true lenses' deviation from the declared ones; 0 is none, 1 a unit
            as it comes out of the box.
        stamp_jitter: uniform error of the stamp, plus or minus [s].
        phase: time of the first exposure [s]; cameras one after another spread the work.
        systematic: share of the unit's systematic depth error (see ``sensor_errors``) that is
            there; 1 for a camera as it comes out of the box, less for one that corrects itself.
    """

    info: RgbdCameraInfo
    T_mount_camera_declared: Pose
    declared: RgbdCameraInfo | None = None
    errors: bool = True
    pose_error: tuple[float, float] = (0.0, 0.0)
    lens_error: float = 0.0
    stamp_jitter: float = 0.0
    phase: float = 0.0
    systematic: float = 0.15


@dataclass(frozen=True)
class WrenchSpec:
    """A simulated force sensor at the flange.

    Attributes:
        rate: readings a second [Hz].
        noise: standard deviations of force [N] and torque [N m].
        bias: standard deviations of the constant errors of force [N] and torque [N m].
        low_pass: corner of the first-order filter [Hz].
        latency: measurement to arrival [s].
        drift: standard deviation by which the errors wander in a minute, of force [N] and torque
            [N m].
        greatest: of each component of force [N] and torque [N m]; beyond that it saturates.
    """

    rate: float = 100.0
    noise: tuple[float, float] = (0.1, 0.005)
    bias: tuple[float, float] = (1.0, 0.02)
    low_pass: float = 30.0
    latency: float = 0.004
    drift: tuple[float, float] = (0.3, 0.006)
    greatest: tuple[float, float] = (300.0, 20.0)


@dataclass(frozen=True)
class CableSpec:
    """A plug's cable that is hung up.

    Attributes:
        hanger: (3,) where it is hung up, in world [m]; length: from the plug to there [m].
        mass: of a metre [kg/m]; bending: stiffness [N m^2]; radius: [m].
    """

    hanger: tuple[float, float, float]
    length: float
    mass: float = 2.26
    bending: float = 0.3
    radius: float = 0.016


@dataclass(frozen=True)
class GripperSpec:
    """A simulated gripper.

    Attributes:
        opening: greatest width [m].
        speed: of the fingertips against each other [m/s].
        delay: command to motion [s]; rate: readings a second [Hz].
        force: with which it closes [N].
    """

    opening: float = 0.085
    speed: float = 0.1
    delay: float = 0.03
    rate: float = 50.0
    force: float = 40.0


@dataclass(frozen=True)
class PersonSpec:
    """Someone in the cell.

    Attributes:
        name: unique in the cell.
        motion: ``script`` (a built-in one by name), ``clip`` (a recorded clip), ``hand`` (a lone
            forearm and hand that the page or a search moves) or ``carry`` (waits, and brings what
            is theirs where it is dragged).
        script: name of the built-in script, such as ``reach_in``, ``walk_by``, ``stand``.
        clip: folder/number of a motion clip, with its file.
        T_world_person: where the motion's frame lies. A script starts at its origin on the floor,
            looking along x. In a clip the robot of the recording stood at the origin on the floor
            and the person stands on the positive x, facing it. A lone hand starts at the origin
            and points along x.
        period: seconds between repetitions of a script [s]; start: first time [s].
        speed_scale: time scale of the motion; max_hand_speed caps it [m/s].
        mirror: left and right exchanged.
        height: of the person [m].
        target: where a script's hand goes, in the script's frame [m]; a place at bench height an
            arm's length ahead if absent.
        distance: how far a script's walk, or one who carries, goes [m].
    """

    name: str
    motion: Literal["script", "clip", "hand", "carry"]
    T_world_person: Pose
    script: str = "reach_in"
    clip: Path | None = None
    period: float = 12.0
    start: float = 2.0
    speed_scale: float = 1.0
    max_hand_speed: float = 2.0
    mirror: bool = False
    height: float = 1.75
    target: tuple[float, float, float] | None = None
    distance: float = 2.5


@dataclass(frozen=True)
class MovingObjectSpec:
    """A thing that moves on a circle or to and fro, or that the page drags.

    Attributes:
        solid: its shape; ``T_frame_solid`` is its pose at the start in world; for one that somebody
            holds in the frame of the part that holds it.
        path: ``circle`` about ``center``, ``line`` from the start to ``center``, ``free`` where it
            is until it is dragged, or ``loose``: it lies where it was put, falls, and is pushed.
        center: (x, y, z) [m]; period: seconds a round [s].
        max_speed: when it is dragged [m/s].
        parts: more solids that it carries, posed in the frame of ``solid``.
        follow: draws a path, its place (3,) [m] at a time [s], which goes before ``path``; or None.
        mass: [kg]; surface, hold: stiffness of its surface and of its stand [N/m], in cells where
            contact pushes.
        held_by: who holds it, such as ``anna/right_hand``; empty for nobody.
        carried_by: who brings it where it is dragged, puts it down and goes; empty for nobody.
    """

    solid: Solid
    path: Literal["circle", "line", "free", "loose"] = "free"
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    period: float = 10.0
    max_speed: float = 1.5
    parts: tuple[Solid, ...] = ()
    follow: Callable[[np.random.Generator], Callable[[float], Vector3]] | None = None
    mass: float = 0.2
    surface: float = 20e3
    hold: float = 2000.0
    held_by: str = ""
    carried_by: str = ""


@dataclass(frozen=True, eq=False)
class Print:
    """A printed board.

    Attributes:
        image: (h, w) uint8, the print at ``per_meter`` pixels a metre.
        x0, y0: its first pixel's outer corner in the board's frame [m]; per_meter: [px/m].
        center: (2,) middle of the corners [m]; half: (2,) half their extent [m].
        scale: print error [1]; bend: (2,) bending along x and y at the edge [m].
    """

    image: Bytes
    x0: float
    y0: float
    per_meter: float
    center: tuple[float, float]
    half: tuple[float, float]
    scale: float = 0.0
    bend: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class BoardSpec:
    """A calibration board in the cell.

    Attributes:
        print: as designed.
        mounted_on: ``flange`` (it then takes the place of the tool's looks) or ``world``.
        T_mount_board: where it is declared to hang; the truth is drawn around it.
        error: scale of the errors of bracket and print; 0 is exact.
        glare: brightness of the lamp's reflection on it, 0..1.
    """

    print: Print
    mounted_on: Literal["flange", "world"]
    T_mount_board: Pose
    error: float = 1.0
    glare: float = 0.8


@dataclass(frozen=True, eq=False)
class PlugSpec:
    """The tool as a plug that hangs in a mount which gives way; its frame is the TCP's.

    Attributes:
        capsules: (m, 6) ends of what enters a socket; radius: of each [m].
        stiffness: of the mount along and about the plug's axes [N/m], [N m/rad].
        cable: weight of the cable that hangs on it [N]; rear: (3,) where [m].
        hung: the cable as it hangs, instead of its weight; None where nobody says how.
        friction: of its sleeve.
        finger: beside it, for lids, or None.
        looks: what its front looks like; drawn: of the tool's own meshes only what lies behind this
            z is drawn [m], since they show no contacts.
    """

    capsules: Floats
    radius: float
    stiffness: tuple[float, float] = (5000.0, 30.0)
    cable: float = 15.0
    rear: tuple[float, float, float] = ROOT
    friction: float = 0.25
    finger: FingerSpec | None = None
    hung: CableSpec | None = None
    looks: tuple[Look, ...] = ()
    drawn: float = np.inf


@dataclass(frozen=True, eq=False)
class Look:
    """Triangles with normals, for drawing only.

    Attributes:
        vertices, normals: (n, 3) [m]; faces: (k, 3).
        color: RGB, 0..1; gloss: 0..1.
        material: what infrared sees of it, as of a solid; empty: infrared does not see it at all.
    """

    vertices: Points
    normals: Points
    faces: Ints
    color: tuple[float, float, float]
    gloss: float = 0.1
    material: str = "black_plastic"


@dataclass(frozen=True, eq=False)
class FingerSpec:
    """A rod beside the plug that a linear actuator puts out; the cell's gripper drives it.

    Attributes:
        T_plug_tip: its tip when it is out, z along the rod, x the way of the pin across its tip.
        stroke: how far it is drawn back [m].
        radius: of rod and pin [m]; length: of the rod, pin: of the pin [m].
        mass: [kg]; force: of the actuator at most [N].
    """

    T_plug_tip: Pose
    stroke: float
    radius: float = 0.005
    length: float = 0.14
    pin: float = 0.015
    mass: float = 0.06
    force: float = 200.0


@dataclass(frozen=True, eq=False)
class LidSpec:
    """A lid.

    Attributes:
        T_frame_lid: where it is when it is shut, in the frame of what it belongs to.
        latch: ``push`` opens and catches when it is pushed in, ``spring`` is pulled over its catch.
        holds: force at its free edge that works the latch [N].
        friction: of its surface; mass: [kg].
        stuck: it does not open farther than this [rad], or at all at 0; None for one that does.
        there: whether there is one.
        color: of its paint, RGB 0..1.
    """

    T_frame_lid: Pose
    latch: Latch
    holds: float = 25.0
    friction: float = 0.25
    mass: float = 0.25
    stuck: float | None = None
    there: bool = True
    color: tuple[float, float, float] = (0.5, 0.5, 0.5)


@dataclass(frozen=True, eq=False)
class SocketSpec:
    """A cavity that a plug enters.

    Attributes:
        name: unique in the cell.
        T_world_socket: its mouth at z = 0, z towards who looks.
        boxes: (n, 4, 4) poses and half: (n, 3) half edges of its walls, in its frame [m].
        looks: what it looks like, in its frame.
        solids: of the car that it belongs to, likewise.
        friction: of its walls.
        mated: friction of the contacts once they are mated [N]; mates: from which depth on [m].
        lid: over it, or None.
    """

    name: str
    T_world_socket: Pose
    boxes: Floats
    half: Floats
    looks: tuple[Look, ...] = ()
    solids: tuple[Solid, ...] = ()
    friction: float = 0.25
    mated: float = 25.0
    mates: float = 0.012
    lid: LidSpec | None = None


@dataclass(frozen=True, eq=False)
class StandingArmSpec:
    """Another arm in the cell, which no driver announces and which does not move.

    Attributes:
        name: unique in the cell; robot: what it is.
        T_world_base: where it stands; q: (n,) its joints [rad].
    """

    name: str
    robot: Robot
    T_world_base: Pose
    q: JointVector


@dataclass(frozen=True)
class WorldSpec:
    """The whole simulated cell.

    Attributes:
        arm: the arm.
        cameras: depth cameras, fixed and on the flange.
        static: declared solids (table, walls, fixtures) in world.
        undeclared: solids that are there but that the cell was not told of; arms: likewise.
        people, objects: what moves.
        floor: whether there is a floor at z = 0.
        time_step: of the physics [s].
        stereo: stereo pairs: the left lens is ``depth``, the right one ``color``.
        wrench: the force sensor at the flange, or None; gripper: likewise.
        board: a calibration board, or None.
        pushes: contact pushes: people's hands and faces and what moves give way, and push back.
        plug: the tool as a plug, or None; needs a force sensor. socket: for it, or None.
    """

    arm: ArmSpec
    cameras: tuple[CameraSpec, ...] = ()
    static: tuple[Solid, ...] = ()
    undeclared: tuple[Solid, ...] = ()
    people: tuple[PersonSpec, ...] = ()
    objects: tuple[MovingObjectSpec, ...] = ()
    floor: bool = True
    time_step: float = 0.002
    stereo: tuple[CameraSpec, ...] = ()
    wrench: WrenchSpec | None = None
    gripper: GripperSpec | None = None
    board: BoardSpec | None = None
    pushes: bool = False
    plug: PlugSpec | None = None
    socket: SocketSpec | None = None
    arms: tuple[StandingArmSpec, ...] = ()

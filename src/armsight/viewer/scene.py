"""The 3D side of the page: the cell as built, and what moves in it; only changes are sent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser

from armsight.arrays import JointPath, Points
from armsight.devices.data import JointState, RgbdFrame
from armsight.devices.world import MovingSolid, MovingSurfaces
from armsight.geometry.pose import to_wxyz
from armsight.mapping.snapshot import CameraStatus, WorkspaceSnapshot
from armsight.motion.data import GuardStatus
from armsight.motion.face import EllipsoidMark, Mark, PointsMark, RegionMark
from armsight.motion.perception import SeenRobot
from armsight.robots.kernels import path_points
from armsight.robots.kinematics import flange_pose
from armsight.robots.robot import Robot
from armsight.runtime.view import SessionView
from armsight.viewer import colors
from armsight.viewer.cameras import CameraFrustum
from armsight.viewer.danger import voxels
from armsight.viewer.first_look import first_look
from armsight.viewer.marks import TaskMarks
from armsight.viewer.nodes import Cloud, Cubes, Line
from armsight.viewer.robot_model import RobotModel
from armsight.viewer.solids import Bodies, SolidGroup, add_solid
from armsight.workcell import Cell

MOST_POINTS = 20_000
MOST_SCANNED = 120_000
"""Points of a cell without an arm: the map is all there is to see."""
MOST_VOXELS = 5_000
MOST_HAZARDS = 3_000
HAZARD_REACH = 0.6
"""Hazards are drawn this near the robot's tip or its base [m]."""
PATH_POINTS = 60


@dataclass(frozen=True)
class Layer:
    """Something that can be switched on and off.

    Attributes:
        label: on the page; hint: what it is.
        on: at the start.
        switch: shows or hides it.
    """

    label: str
    hint: str
    on: bool
    switch: Callable[[bool], None]


class CellScene:
    """Draws a cell and follows a session's view."""

    def __init__(self, server: viser.ViserServer, cell: Cell) -> None:
        self._api = api = server.scene
        self._cell = cell
        self._robot: Robot = cell.robot
        _light(api)
        self._grid = api.add_grid(
            "/floor",
            width=12.0,
            height=12.0,
            cell_size=0.25,
            section_size=1.0,
            cell_color=(58, 64, 76),
            section_color=(84, 92, 108),
            cell_thickness=0.6,
            section_thickness=1.0,
            fade_distance=14.0,
            fade_strength=1.5,
            infinite_grid=True,
        )
        base = "/base"
        api.add_frame(
            base,
            show_axes=False,
            wxyz=to_wxyz(cell.T_world_base),
            position=cell.T_world_base[:3, 3],
        )
        self._axes = api.add_frame(
            f"{base}/axes", axes_length=0.15, axes_radius=0.004, visible=False
        )
        self._solids = api.add_frame(f"{base}/static", show_axes=False)
        for solid in cell.static:
            node = f"{base}/static/{solid.name}"
            add_solid(api, node, solid, solid.T_frame_solid, np.array([0.0, 0.0, 0.3]))
        self._robot_root = api.add_frame(f"{base}/robot", show_axes=False)
        self.robot = RobotModel(api, f"{base}/robot", cell.robot)
        self._camera_root = api.add_frame(f"{base}/cameras", show_axes=False)
        self.cameras = {
            camera.info.name: CameraFrustum(api, f"{base}/cameras/{camera.info.name}", camera.info)
            for camera in cell.cameras
        }
        self.movers = SolidGroup(api, "/movers")
        self.people = Bodies(api, "/people")
        self._moved = False
        armed = cell.robot.n > 0
        self.cloud = Cloud(api, f"{base}/cloud", 0.008 if armed else 0.013, "circle")
        self.hazards = Cloud(api, f"{base}/hazards", 0.012, "square")
        self.hazards.visible = False
        self.things = Cloud(api, f"{base}/things", 0.016, "square")
        self.voxels = Cubes(api, f"{base}/voxels")
        self.voxels.visible = armed
        self._most_points = MOST_POINTS if armed else MOST_SCANNED
        self.planned = Line(api, f"{base}/planned", colors.PLANNED, 0.008, PATH_POINTS)
        self.executed = Line(api, f"{base}/executed", colors.EXECUTED, 0.005, PATH_POINTS)
        self.nearest = Line(api, f"{base}/nearest", colors.NEAREST, 0.006, 2)
        self._distance = api.add_label(
            f"{base}/distance", "", anchor="bottom-center", font_screen_scale=1.1, visible=False
        )
        self._labels_on = True
        self.marks = TaskMarks(api, f"{base}/task")
        self.permit = TaskMarks(api, f"{base}/permit")
        self.robots = TaskMarks(api, f"{base}/robots")
        self._drawn_face: object = None
        self._drawn_robots: object = None
        tip = self._robot.T_last_flange
        if self._robot.tool is not None:
            tip = tip @ self._robot.tool.T_flange_tcp
        self._tip = (np.array([self._robot.n]), np.ascontiguousarray(tip[None, :3, 3]))
        self._drawn_snapshot = -1
        self._drawn_path: object = None
        self._drawn_executed: object = None
        first_look(server, cell)

    def layers(self) -> list[Layer]:
        """What the person may switch."""

        def of(*nodes: Any) -> Callable[[bool], None]:
            def switch(on: bool) -> None:
                for node in nodes:
                    node.visible = on

            return switch

        return [
            Layer("Cloud", "merged, cleaned points; the arm is filtered out", True, of(self.cloud)),
            Layer(
                "Voxels",
                "occupied now (red) to left 24 s ago (blue)",
                self.voxels.visible,
                of(self.voxels),
            ),
            Layer(
                "Hazards",
                "where a person could be, near the arm: seen (orange), unseen (violet)",
                False,
                of(self.hazards),
            ),
            Layer(
                "Things",
                "what is solid but known to be no person, once the cell was said to be empty",
                True,
                of(self.things),
            ),
            Layer(
                "Paths",
                "of the tip: planned (green), driven (grey)",
                True,
                of(self.planned, self.executed),
            ),
            Layer(
                "Distance", "the two nearest points of robot and hazard", True, self._show_nearest
            ),
            Layer(
                "Task",
                "what the task marks, and what it may touch (green) or may not (red)",
                True,
                of(self.marks, self.permit),
            ),
            Layer("Cameras", "frustums with what they see", True, of(self._camera_root)),
            Layer(
                "People",
                "the simulation's truth, for comparison",
                True,
                of(self.people, self.movers),
            ),
            Layer("Robot", "at the last joint reading", True, of(self._robot_root)),
            Layer("Solids", "what the cell's file declares", True, of(self._solids)),
            Layer("Axes", "of the robot's base: x red, y green, z blue", False, of(self._axes)),
            Layer("Floor", "one line every 25 cm", True, of(self._grid)),
        ]

    def update(self, view: SessionView) -> None:
        """Follow a view."""
        joints = view.joints
        if joints is not None:
            self.robot.move(joints.position)
        self._update_cameras(view, joints)
        self._update_movers(view.movers, view.bodies)
        snapshot = view.snapshot
        if snapshot is not None and snapshot.sequence != self._drawn_snapshot:
            self._update_map(snapshot, view.now)
        if view.guard is not None:
            self._update_guard(view.guard, snapshot)
        if view.face is not self._drawn_face:
            self._drawn_face = view.face
            self.marks.show(() if view.face is None else view.face.face.marks)
        if view.robots is not self._drawn_robots:
            self._drawn_robots = view.robots
            self.robots.show(_robot_marks(view.robots))

    def forget(self) -> None:
        """After a reset: draw the map anew."""
        self._drawn_snapshot = -1

    # -- parts ----------------------------------------------------------------------------------

    def _update_cameras(self, view: SessionView, joints: JointState | None) -> None:
        frames: dict[str, RgbdFrame] = {frame.camera: frame for frame in view.frames}
        health: dict[str, CameraStatus] = (
            {} if view.snapshot is None else {s.name: s for s in view.snapshot.cameras}
        )
        q = self._robot.home if joints is None else joints.position
        for name, camera in self.cameras.items():
            frame, status = frames.get(name), health.get(name)
            if frame is not None and frame.T_base_camera is not None:
                camera.move(frame.T_base_camera)
            elif camera.info.mounted_on == "flange":
                camera.move(flange_pose(self._robot, q) @ camera.info.T_mount_camera)
            camera.show_health(None if status is None else status.alive)

    def _update_movers(
        self, movers: tuple[MovingSolid, ...], bodies: tuple[MovingSurfaces, ...]
    ) -> None:
        """People in detail where their looks are known, everything else as solids."""
        if self.people.visible:
            self.people.show(bodies)
        known = {body.name.split("/")[0] for body in bodies}
        rest = [m for m in movers if m.name.split("/")[0] not in known]
        if not rest and not self._moved:
            return
        self._moved = bool(rest)
        if self.movers.visible:
            self.movers.show([m.solid for m in rest], [m.T_world_solid for m in rest])

    def _update_map(self, snapshot: WorkspaceSnapshot, now: float) -> None:
        self._drawn_snapshot = snapshot.sequence
        if self.cloud.visible:
            points = snapshot.cloud
            if len(points) > self._most_points:
                points = points[:: -(-len(points) // self._most_points)]
            low, high = float(snapshot.grid.origin[2]), _top(snapshot)
            self.cloud.show(points, colors.by_value(colors.HEIGHT, points[:, 2], low, high))
        if self.things.visible:
            shades = np.tile(np.array(colors.THING, np.uint8), (len(snapshot.things), 1))
            self.things.show(snapshot.things, shades)
        if self.voxels.visible:
            centers, shades, _ = voxels(snapshot, now, MOST_VOXELS)
            self.voxels.show(centers, 0.92 * snapshot.grid.voxel, shades)

    def _update_guard(self, guard: GuardStatus, snapshot: WorkspaceSnapshot | None) -> None:
        if guard.path is not self._drawn_path:
            self._drawn_path = guard.path
            self.planned.show(self._tips(guard.path))
        if guard.executed is not self._drawn_executed:
            self._drawn_executed = guard.executed
            self.executed.show(self._tips(guard.executed))
        self.permit.show(_permitted(guard))
        hazard, body = guard.nearest_hazard, guard.nearest_body
        near = hazard is not None and body is not None and np.isfinite(guard.distance)
        if near:
            assert hazard is not None
            assert body is not None
            self.nearest.show(np.stack([body, hazard]))
            self._distance.position = 0.5 * (body + hazard)
            self._distance.text = f"{guard.distance:.2f} m"
        else:
            self.nearest.show(None)
        self._distance.visible = near and self._labels_on
        if self.hazards.visible and snapshot is not None:
            self._show_hazards(snapshot, body)

    def _show_hazards(self, snapshot: WorkspaceSnapshot, body: Points | None) -> None:
        center = np.zeros(3) if body is None else body
        square = np.square(snapshot.hazards - center.astype(np.float32)).sum(axis=1)
        near = np.flatnonzero(square < HAZARD_REACH**2)
        if len(near) > MOST_HAZARDS:
            near = near[np.argpartition(square[near], MOST_HAZARDS)[:MOST_HAZARDS]]
        shades = np.where(
            snapshot.hazard_unknown[near][:, None],
            np.array(colors.UNSEEN, np.uint8),
            np.array(colors.SEEN, np.uint8),
        )
        self.hazards.show(snapshot.hazards[near], shades)

    def _show_nearest(self, on: bool) -> None:
        self._labels_on = on
        self.nearest.visible = on
        self._distance.visible = on and bool(self._distance.text)

    def _tips(self, path: JointPath | None) -> Points | None:
        """(k, 3) where the tip goes along a joint path."""
        if path is None or len(path) < 2:
            return None
        # A straight line of joints is a curve of the tip, and a long path has too many points.
        at = np.linspace(0.0, len(path) - 1.0, PATH_POINTS)
        knots = np.arange(len(path))
        dense = np.stack([np.interp(at, knots, column) for column in path.T], axis=1)
        robot = self._robot
        points = path_points(dense, robot.T_link_joint, robot.axis, *self._tip)
        return np.asarray(points[:, 0])


def _permitted(guard: GuardStatus) -> tuple[Mark, ...]:
    """The region that a contact permit is about, where it is now; round ones as ellipsoids."""
    permit = guard.permit
    if permit is None or permit.region is None:
        return ()
    region, color = permit.region, colors.PERMITTED if permit.holds else colors.REFUSED
    T = np.array(region.T_base_region, float)
    T[:3, 3] = region.center(guard.stamp)
    a, b, _ = region.size
    if region.shape == "box":
        return (RegionMark(permit.name, T, np.asarray(region.size, float), color),)
    long = a if region.shape == "sphere" else a + 0.5 * b
    return (EllipsoidMark(permit.name, T, np.array([a, a, long]), color),)


def _robot_marks(robots: tuple[SeenRobot, ...]) -> tuple[Mark, ...]:
    """Arms that no driver announces: what is seen of their bodies, and their joints."""
    marks: list[Mark] = []
    for k, seen in enumerate(robots, start=1):
        what = "unknown arm" if seen.robot == "unknown" else seen.robot
        marks.append(PointsMark(f"{what} (unannounced {k})", seen.points, 0.008, colors.SEEN))
        if len(seen.joints):
            marks.append(PointsMark(f"joints {k}", seen.joints, 0.03, colors.SEEN))
    return tuple(marks)


def _top(snapshot: WorkspaceSnapshot) -> float:
    grid = snapshot.grid
    return float(grid.origin[2] + grid.voxel * grid.shape[2])


def _light(api: viser.SceneApi) -> None:
    """Two soft lamps and the sky; nothing is fetched from the network."""
    api.set_up_direction("+z")
    api.configure_environment_map(None)
    api.configure_default_lights(enabled=False)
    api.add_light_hemisphere(
        "/lights/sky", sky_color=(225, 235, 255), ground_color=(130, 125, 118), intensity=2.0
    )
    api.add_light_directional(
        "/lights/key",
        color=(255, 247, 235),
        intensity=1.9,
        position=(2.5, -1.5, 4.0),
        cast_shadow=True,
    )
    api.add_light_directional(
        "/lights/fill", color=(205, 220, 255), intensity=0.7, position=(-3.0, 2.5, 2.0)
    )

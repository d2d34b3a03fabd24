"""Physics, rendering and sensor errors of the simulated cell, each alone and four cameras together.

Frames are those of a Kinect v2 (512 x 424, lens distortion on) in a UR5 cell with a table, walls
and a person. Rendering is measured in this thread; the last lines run the world as a session does,
with its darkroom thread beside it.
"""

from __future__ import annotations

import resource
import time
from dataclasses import replace

import numpy as np

from armsight.devices.camera_models import camera_info
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, look_at, make_pose
from armsight.geometry.shapes import Solid
from armsight.robots import load_robot
from armsight.simulation.gl import check_opengl
from armsight.simulation.rendering import Kind
from armsight.simulation.sensor_errors import DepthSensor
from armsight.simulation.spec import ArmSpec, CameraSpec, PersonSpec, WorldSpec
from armsight.simulation.world import SimulatedWorld
from common import Report, measure

CORNERS = ((1.55, 1.35, 1.95), (1.55, -1.35, 1.95), (-1.3, -1.35, 2.0), (-1.3, 1.35, 2.0))


def cell(robot: str, cameras: int, people: int) -> WorldSpec:
    """A cell with as many corner cameras and people."""
    arm = load_robot(robot)
    specs = []
    for i, eye in enumerate(CORNERS[:cameras]):
        T = look_at(eye, (0.2, 0.0, 0.95))
        info = camera_info(f"corner_{i}", "kinect_v2", T_mount_camera=T, color_scale=0.5)
        specs.append(CameraSpec(info, T, phase=i / 60.0))
    wall = Solid("wall", "box", (0.1, 3.8, 2.4), make_pose(None, (1.95, 0.0, 1.2)))
    return WorldSpec(
        ArmSpec(arm, make_pose(None, (0, 0, 0.75)), arm.home),
        cameras=tuple(specs),
        static=(
            Solid("table", "box", (1.4, 1.4, 0.75), make_pose(None, (0.35, 0, 0.375))),
            wall,
            replace(wall, name="back", T_frame_solid=make_pose(None, (-1.75, 0, 1.2))),
        ),
        people=tuple(
            PersonSpec(f"person_{i}", "script", from_rpy((0, 0, np.pi), (1.35, 0.5 * i, 0)))
            for i in range(people)
        ),
    )


def run(world: SimulatedWorld, seconds: float) -> None:
    """Command at 100 Hz, read the arm and every camera, as a session does."""
    start = world.clock.now()
    n = world.spec.arm.robot.n
    for k in range(round(seconds * 100)):
        world.arm.command_velocity(np.full(n, 0.3 * np.sin(0.02 * k)))
        world.advance(start + (k + 1) * 0.01)
        world.arm.read()
        for camera in world.cameras:
            camera.read()


def cpu() -> float:
    """CPU seconds of all threads of this process."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def realtime(report: Report, key: str, spec: WorldSpec, seconds: float, **budget: str) -> None:
    """Simulated seconds a second, and what a simulated second costs in CPU time."""
    with SimulatedWorld(spec) as world:
        run(world, 0.5)
        factors, before = [], cpu()
        rounds = report.rounds(5)
        for _ in range(rounds):
            start = time.perf_counter()
            run(world, seconds)
            factors.append(seconds / (time.perf_counter() - start))
        cost = (cpu() - before) / (rounds * seconds)
    low, high = np.percentile(factors, [10, 90])
    report.add(
        key,
        float(np.median(factors)),
        "x real time",
        spread=(float(low), float(high)),
        note=f"{1e3 * cost:.0f} ms CPU a simulated second",
        **budget,
    )


def main() -> None:
    """Measure everything."""
    report = Report("simulation", __doc__)
    start = time.perf_counter()
    world = SimulatedWorld(cell("ur5", 4, 1), seed=0)
    report.add("build_world", time.perf_counter() - start, "s", note="compiled kernels cached")
    camera, renderer = world.cameras[0], world.renderer
    lens, T = camera.info.depth, camera.T_mount_camera
    shots = [renderer.take(world._data, T, lens)]
    for name, fixed in (("depth_and_segmentation", True), ("the_same_by_a_moving_camera", False)):

        def picture(fixed: bool = fixed) -> None:
            renderer.give_back(shots.pop())
            shots.append(renderer.take(world._data, T, lens, fixed=fixed))
            renderer.depth(shots[0], lens)

        timing = measure(picture, rounds=report.rounds(200), warmup=20)
        report.add(
            f"{name}_512x424",
            timing.median * 1e3,
            "ms",
            spread=timing.spread_ms,
            must="<= 15",
            aim="<= 5",
            note=f"{check_opengl()}; {1e3 * timing.cpu_per_round:.1f} ms CPU",
        )
    seen = renderer.depth(shots[0], lens)
    for model in ("kinect_v2", "kinect_v1"):
        info = replace(camera.info, model=model)
        sensor = DepthSensor(info, world._cell.materials, (0, 1))
        timing = measure(
            lambda sensor=sensor: sensor.measure(seen, 1, 0.0), rounds=report.rounds(200), warmup=5
        )
        report.add(
            f"errors_{model}_512x424",
            timing.median * 1e3,
            "ms",
            spread=timing.spread_ms,
            note=f"{1e3 * timing.cpu_per_round:.1f} ms CPU",
        )
    lens = PinholeCamera(720, 480, 500.0, 500.0, 359.5, 239.5)

    def colour(kind: Kind) -> None:
        shot = renderer.take(world._data, T, lens, kind)
        renderer.color(shot, lens)
        renderer.give_back(shot)

    for kind, key in (("color", "color_ms"), ("still", "still_ms")):
        timing = measure(lambda kind=kind: colour(kind), rounds=report.rounds(30), warmup=3)
        report.add(
            key,
            timing.cpu_per_round * 1e3,
            "ms",
            must="<= 60" if kind == "color" else "",
            aim="<= 25" if kind == "color" else "",
            note=f"CPU, 720x480 with shadows; {timing.median * 1e3:.0f} ms wall",
        )
    world.close()
    realtime(report, "physics_ur10_500hz", cell("ur10", 0, 0), 5.0, must=">= 10", aim=">= 30")
    realtime(report, "physics_person_truth", cell("ur10", 0, 1), 5.0)
    realtime(report, "four_kinect_v2_15hz", cell("ur5", 4, 1), 2.0, must=">= 1", aim=">= 2")
    report.finish()


if __name__ == "__main__":
    main()

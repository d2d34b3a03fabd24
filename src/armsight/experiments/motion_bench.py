"""MotionBenchMaker's problems (Chamzas et al., RA-L 2022), read from the archives as they are."""

from __future__ import annotations

import tarfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armsight.arrays import JointVector, Pose
from armsight.errors import ArmsightError
from armsight.geometry.pose import from_quaternion
from armsight.geometry.shapes import Solid
from armsight.robots.loading import load_urdf
from armsight.robots.robot import Robot

ROBOTS = ("ur5", "panda")
MOUNT = {"ur5": "offset_link", "panda": "panda_link0"}


@dataclass(frozen=True)
class Problem:
    """One scene with one question.

    Attributes:
        robot: ``ur5`` or ``panda``.
        family: the set, such as ``box``; number: within it.
        solids: the scene, in the frame of the robot's URDF root.
        start, goal: (n,) [rad].
    """

    robot: str
    family: str
    number: int
    solids: tuple[Solid, ...]
    start: JointVector
    goal: JointVector

    @property
    def name(self) -> str:
        """Such as ``box_ur5 0007``."""
        return f"{self.family}_{self.robot} {self.number:04d}"


def find_data() -> Path:
    """Folder of the archives, in ``../shared/data`` beside the repository.

    Raises:
        ArmsightError: it is not there.
    """
    for parent in Path(__file__).resolve().parents:
        folder = parent.parent / "shared" / "data" / "motion" / "motionbenchmaker"
        if folder.is_dir():
            return folder
    raise ArmsightError(
        "MotionBenchMaker's problems are not beside the repository: expected the folder "
        "../shared/data/motion/motionbenchmaker with ur5_problems_001-050.tar.bz2"
    )


def load_bench_robot(name: str, folder: Path) -> Robot:
    """The robot of the problems, covered by the spheres of its own "spherized" URDF."""
    return load_urdf(folder / f"{name}_spherized.urdf", name=name, meshes=False)


def load_problems(name: str, robot: Robot, folder: Path) -> list[Problem]:
    """All problems of one robot, in order of family and number."""
    archive = folder / f"{name}_problems_001-050.tar.bz2"
    texts: dict[str, bytes] = {}
    with tarfile.open(archive, "r:bz2") as tar:
        for member in tar:
            file = tar.extractfile(member) if member.isfile() else None
            if file is not None:
                texts[member.name] = file.read()
    problems = []
    for path in sorted(texts):
        folder_name, file_name = path.split("/")[-2:]
        if not file_name.startswith("request"):
            continue
        number = int(file_name[len("request") : -len(".yaml")])
        scene = texts[path.replace("request", "scene")]
        request = _load(texts[path])
        problems.append(
            Problem(
                name,
                folder_name.removesuffix(f"_{name}"),
                number,
                _solids(_load(scene)),
                _start(request, robot),
                _goal(request, robot),
            )
        )
    return problems


def _load(text: bytes) -> Any:
    return yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506


def _start(request: Any, robot: Robot) -> JointVector:
    state = request["start_state"]["joint_state"]
    values = dict(zip(state["name"], state["position"]))
    return np.array([values[j] for j in robot.joint_names], float)


def _goal(request: Any, robot: Robot) -> JointVector:
    constraints = request["goal_constraints"][0]["joint_constraints"]
    values = {c["joint_name"]: c["position"] for c in constraints}
    return np.array([values[j] for j in robot.joint_names], float)


def _solids(scene: Any) -> tuple[Solid, ...]:
    solids = []
    for thing in scene["world"]["collision_objects"]:
        T_world_thing = _pose(thing["pose"]) if "pose" in thing else np.eye(4)
        for i, (shape, pose) in enumerate(zip(thing["primitives"], thing["primitive_poses"])):
            size = [float(x) for x in shape["dimensions"]]
            T = T_world_thing @ _pose(pose)
            name = f"{thing['id']}-{i}"
            if shape["type"] == "box":
                solids.append(Solid(name, "box", (size[0], size[1], size[2]), T))
            elif shape["type"] == "cylinder":
                solids.append(Solid(name, "cylinder", (size[1], size[0], 0.0), T))
            else:
                raise ArmsightError(f"scene {scene.get('name')}: {shape['type']} is not known")
    return tuple(solids)


def _pose(value: Any) -> Pose:
    return from_quaternion(value["orientation"], value["position"])

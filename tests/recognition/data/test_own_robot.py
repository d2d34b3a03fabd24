"""A set of a user's own arm: drawn from its files, labelled by its kinematics."""

import struct
from pathlib import Path

import numpy as np
import pytest

from armsight.errors import UsageError
from armsight.recognition.any_arm.learning.examples import landmark_pixels, model_of, pack_shards
from armsight.recognition.data import LabelledSet
from armsight.recognition.data.generate import generate
from armsight.recognition.data.order import make_order
from armsight.recognition.data.sample import is_robot_type, robot_number
from armsight.recognition.training.tensors_file import read_tensors
from armsight.robots.catalogue import load_robot


def box(file: Path, side: float, length: float) -> None:
    """A box on end as a binary STL."""
    low, high = np.array([-side, -side, 0.0]), np.array([side, side, length])
    corner = np.array([[high[k] if b >> k & 1 else low[k] for k in range(3)] for b in range(8)])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    rows = [struct.pack("<12fH", *[0.0] * 3, *corner[list(f)].ravel(), 0) for f in faces]
    file.write_bytes(bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows))


def own_arm(folder: Path) -> Path:
    """Three joints, four boxes; its spheres are given, so that nothing is fitted."""
    lengths = (0.2, 0.3, 0.3, 0.15)
    links, joints = [], []
    for k, length in enumerate(lengths):
        box(folder / f"l{k}.stl", 0.05, length)
        balls = "".join(
            f'<collision><origin xyz="0 0 {z:.2f}"/><geometry><sphere radius="0.08"/></geometry>'
            "</collision>"
            for z in np.linspace(0.0, length, 4)
        )
        links.append(
            f'<link name="l{k}"><visual><geometry><mesh filename="l{k}.stl"/></geometry></visual>'
            f"{balls}</link>"
        )
    for k, axis in enumerate(("0 0 1", "0 1 0", "0 1 0")):
        joints.append(
            f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
            f'<origin xyz="0 0 {lengths[k]}"/><axis xyz="{axis}"/>'
            '<limit lower="-2" upper="2" velocity="1" effort="9"/></joint>'
        )
    file = folder / "my arm.urdf"
    file.write_text(f'<robot name="mine">{"".join(links + joints)}</robot>')
    return file


def test_crops_of_an_own_arm_are_drawn_and_packed(gl: str, tmp_path: Path) -> None:
    path = str(own_arm(tmp_path))
    order = make_order("crops", {path: 5, "ur5": 5}, 3, (96, 96), 10)
    generate(order, tmp_path / "set")
    held = LabelledSet.open(tmp_path / "set")
    assert sorted({r.robot for r in held.rows}) == sorted([path, "ur5"])
    model = model_of(load_robot(path))
    on = of = 0
    for sample in held:
        if sample.robot != path:
            continue
        assert sample.link_ids.max() == 4
        pixels = landmark_pixels(model, sample)
        at = np.round(pixels[np.isfinite(pixels).all(1)]).astype(int)
        at = at[(at >= 0).all(1) & (at < 96).all(1)]
        on += int(sample.mask[at[:, 1], at[:, 0]].sum())
        of += len(at)
    # Landmarks lie in the arm: wherever nothing stands before it, its own picture shows there.
    assert of > 15
    assert on > 0.7 * of
    assert pack_shards(tmp_path / "set", tmp_path / "packed") == 1
    arrays, words = read_tensors(tmp_path / "packed" / "arms-00000.safetensors")
    assert words["names"].split("\n") == list(dict.fromkeys(r.robot for r in held.rows))
    mine = arrays["robot"] == words["names"].split("\n").index(path)
    seen = arrays["coordinates"][mine][..., 0] != -128
    assert seen.mean() == pytest.approx((arrays["links"][mine] > 0).mean(), rel=0.15)


def test_a_set_of_another_geometry_is_not_gone_on_with(tmp_path: Path) -> None:
    """A joint of one's own arm that was mended: its meshes stay, every label changes."""
    file = own_arm(tmp_path)
    before = make_order("crops", {str(file): 5}, 3, (96, 96)).manifest
    assert make_order("crops", {str(file): 5}, 3, (96, 96)).manifest == before
    written = file.read_text()
    for old, new in (('xyz="0 0 0.3"', 'xyz="0 0 0.31"'), ('upper="2"', 'upper="1"')):
        assert old in written
        file.write_text(written.replace(old, new))
        assert make_order("crops", {str(file): 5}, 3, (96, 96)).manifest != before
    # What was made of arms of the catalogue goes on: their hash is what it was.
    meshes = make_order("crops", {"ur5": 5}, 3, (96, 96)).manifest.meshes
    assert meshes["ur5"].startswith("9fcf9cbbb4a42e05")


def test_names_of_robots() -> None:
    assert is_robot_type("./x.urdf")
    assert is_robot_type("fr3")
    assert not is_robot_type("robot")
    numbers = [robot_number(n) for n in ("ur3", "unknown", "fr3", "a/x.urdf", "b/x.urdf")]
    assert numbers[3] == numbers[4]
    assert len(set(numbers)) == 4
    with pytest.raises(UsageError, match="path of a URDF"):
        make_order("crops", {"robot": 5}, 0, (96, 96))

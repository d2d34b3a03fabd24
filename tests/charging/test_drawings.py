"""Ports of one's own by a file: read as they were written, found, refused where they cannot be."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from painted_ports import LENS, facing, paint

from armsight.charging.ports.drawing_file import add_drawing, read_drawing, written
from armsight.charging.ports.table import PORTS
from armsight.cli import run
from armsight.errors import UsageError

OWN = """
name = "three_pins"
title = "Three pins in a triangle"
depth = 30
turns = 3
plate = { radius = 44 }

[[edge]]
name = "mouth"
kind = "mouth"
radius = 30
flat = 24
z = -1

[[edge]]
name = "pedestal"
kind = "pedestal"
radius = 22.5

[[edge]]
name = "A"
kind = "recess"
y = 11
radius = 6

[[edge]]
name = "B"
kind = "recess"
x = 9.5
y = -5.5
radius = 6

[[edge]]
name = "C"
kind = "recess"
x = -9.5
y = -5.5
radius = 4
"""


@pytest.fixture
def known():
    """What is added to the table is gone again after the test."""
    before = dict(PORTS)
    yield
    PORTS.clear()
    PORTS.update(before)


@pytest.mark.parametrize("name", list(PORTS))
def test_a_type_is_read_as_it_was_written(name, tmp_path):
    file = tmp_path / "port.toml"
    file.write_text(written(PORTS[name], "again"))
    assert read_drawing(file) == replace(PORTS[name], name="again")


def test_the_command_writes_a_drawing_to_start_from(tmp_path, capsys):
    assert run(["detect-port", "--write-drawing", "type2"]) == 0
    file = tmp_path / "port.toml"
    file.write_text(capsys.readouterr().out)
    assert read_drawing(file).name == "my_type2"


def test_a_port_of_ones_own_is_found_and_told_from_the_others(known, tmp_path, capsys):
    file, picture = tmp_path / "own.toml", tmp_path / "port.png"
    file.write_text(OWN)
    words = ["detect-port", str(picture), "--drawing", str(file)]
    words += ["--intrinsics", f"{LENS.fx},{LENS.fy},{LENS.cx},{LENS.cy}"]
    T = facing(0.02, 0.01, 0.4, (0.3, 0.1), 0.1)
    cv2.imwrite(str(picture), paint(read_drawing(file), T, LENS, 0))
    assert run(words) == 0
    row = json.loads(capsys.readouterr().out.splitlines()[0])
    assert row["port"] == "three_pins"
    np.testing.assert_allclose(row["position_m"], T[:3, 3], atol=0.004)
    cv2.imwrite(str(picture), paint(PORTS["type2"], T, LENS, 0))
    assert run(words) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[0])["port"] == "type2"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("depth = 30", "depth 30", "not TOML"),
        ("depth = 30", "depth = 3" + 5000 * "0", "not TOML"),
        ("depth = 30", "depth = nan", "depth: Input should be a finite number"),
        ("depth = 30", "depth = -3", "depth: Input should be greater than 0.5"),
        ("depth = 30", "", "depth: Field required"),
        ("depth = 30", "depht = 30", "depth: Field required|depht: Extra inputs"),
        ("turns = 3", "turns = 0", "turns: Input should be greater than or equal to 1"),
        ('"three_pins"', '"Three Pins"', "name: String should match pattern"),
        ('name = "B"', 'name = "A"', "two edges are called 'A'"),
        ('"pedestal"\nradius', '"recess"\nradius', "a pedestal about the origin and the mouth"),
        ("radius = 22.5", "radius = 29", "radii of 29 and 30: 0.97; only rings of 0.6 to 0.9"),
        ("flat = 24", "flat = 33", "flat is 33, which does not cut it"),
        ("x = -9.5", "x = -60", "the recess 'C' lies outside of every mouth"),
        ("x = -9.5", "x = 1e9", "edge.4.x: Input should be less than or equal to 150"),
        ('kind = "mouth"\n', 'kind = "mouth"\nx = 3\n', "has to be round about the origin"),
        ('kind = "mouth"', 'kind = "hole"', "edge.0.kind: Input should be 'mouth', 'pedestal'"),
        ("turns = 3", 'turns = 3\ncontains = "type9"', "no such type; there are type1, type2"),
    ],
)
def test_a_broken_drawing_is_an_error_that_says_where(tmp_path, old, new, words):
    assert old in OWN
    file = tmp_path / "own.toml"
    file.write_text(OWN.replace(old, new))
    with pytest.raises(UsageError, match=f"own.toml: .*({words})"):
        read_drawing(file)


def test_a_drawing_that_is_none_is_an_error(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        read_drawing(tmp_path / "none.toml")
    with pytest.raises(UsageError, match="cannot be read"):
        read_drawing(tmp_path)
    (tmp_path / "picture.toml").write_bytes(bytes(range(256)))
    with pytest.raises(UsageError, match="not TOML"):
        read_drawing(tmp_path / "picture.toml")
    (tmp_path / "long.toml").write_text("#" * 200_000)
    with pytest.raises(UsageError, match="a drawing's file is short"):
        read_drawing(tmp_path / "long.toml")


def test_no_drawing_takes_the_name_of_another_port(known, tmp_path):
    file = tmp_path / "own.toml"
    file.write_text(OWN.replace('"three_pins"', '"type2"'))
    with pytest.raises(UsageError, match="another port is called type2"):
        add_drawing(file)
    file.write_text(OWN)
    assert add_drawing(file) == add_drawing(file)
    file.write_text(OWN.replace("depth = 30", "depth = 31"))
    with pytest.raises(UsageError, match="another port is called three_pins"):
        add_drawing(file)

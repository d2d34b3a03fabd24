"""The table of ports, and what is made from it."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from armsight.charging.ports.curves import curves
from armsight.charging.ports.drawing import drawing
from armsight.charging.ports.meshes import surfaces
from armsight.charging.ports.outline import Outline, inside_any, sample_union
from armsight.charging.ports.table import PORTS, drawn, port
from armsight.errors import UsageError


@pytest.mark.parametrize(
    ("outline", "length"),
    [
        (Outline(0.01, -0.02, 0.03), 2 * np.pi * 0.03),
        (Outline(0, 0, 0.01, 0.02), 2 * np.pi * 0.01 + 4 * 0.02),
        # a D: the chord 2 sqrt(r^2 - c^2) and the arc below it
        (Outline(0, 0, 0.05, flat=0.03), 2 * 0.04 + 0.05 * (2 * np.pi - 2 * np.arccos(0.6))),
    ],
)
def test_the_length_of_an_outline(outline: Outline, length: float) -> None:
    assert outline.length == pytest.approx(length)
    points, normals = outline.sample(0.0002)
    closed = np.vstack([points, points[:1]])
    assert np.linalg.norm(np.diff(closed, axis=0), axis=1).sum() == pytest.approx(length, rel=2e-3)
    assert outline.contains(points - 1e-5 * normals).all()
    assert not outline.contains(points + 1e-5 * normals).any()


def test_a_union_is_the_border_of_both() -> None:
    shapes = [Outline(0, 0, 0.03), Outline(0, -0.035, 0.015, 0.01)]
    points, normals = sample_union(shapes, 0.0005)
    assert not inside_any(shapes, points + 1e-5 * normals).any()
    assert inside_any(shapes, points - 1e-5 * normals).all()


@pytest.mark.parametrize("name", PORTS)
def test_layouts_are_symmetric_and_fit_into_each_other(name: str) -> None:
    entry = PORTS[name]
    places = {(round(p.x, 6), round(p.y, 6)) for p in entry.pins}
    assert {(-x, y) for x, y in places} == places
    pedestals = [rim.outline for rim in entry.of_kind("pedestal")]
    mouths = [rim.outline for rim in entry.of_kind("mouth")]
    for rim in entry.of_kind("recess"):
        edge, _ = rim.outline.sample(0.001)
        assert inside_any(pedestals, edge).all(), rim.name
    for outline in pedestals:
        assert inside_any(mouths, outline.sample(0.001)[0]).all()


def test_plug_and_inlet_mate() -> None:
    """Tubes of the plug enter the recesses, its bore goes over the pedestal, its sleeve inside."""
    inlet, plug = port("type2"), port("type2_plug")
    recess = {rim.name: rim.outline for rim in inlet.of_kind("recess")}
    for rim in plug.of_kind("pedestal"):
        gap = recess[rim.name].radius - rim.outline.radius
        assert gap == pytest.approx(0.75e-3)
    bore, core = plug.of_kind("mouth")[0].outline, inlet.of_kind("pedestal")[0].outline
    assert 0.3e-3 <= bore.radius - core.radius <= 0.6e-3
    assert bore.flat is not None
    assert core.flat is not None
    assert bore.flat > core.flat
    assert inside_any([inlet.of_kind("mouth")[0].outline], plug.plate.sample(0.001)[0]).all()


def test_makes_differ_within_their_tolerance() -> None:
    nominal = port("ccs2")
    made = drawn(nominal, np.random.default_rng(3))
    for a, b in zip(nominal.rims, made.rims):
        assert abs(a.outline.radius - b.outline.radius) <= 2 * a.radius_tolerance + 1e-12
        assert abs(a.outline.x - b.outline.x) <= 2 * a.place_tolerance + 1e-12
    assert made != nominal


def test_an_unknown_port_is_named() -> None:
    with pytest.raises(UsageError, match="no port or plug 'chademo'; choose one of type1, type2"):
        port("chademo")


@pytest.mark.parametrize("name", PORTS)
def test_the_drawing_is_true_to_scale(name: str) -> None:
    root = ET.fromstring(drawing(PORTS[name]))  # our own text
    circles = {c.get("id"): c for c in root.iter("{http://www.w3.org/2000/svg}circle")}
    for pin in PORTS[name].pins if not PORTS[name].plug else ():
        circle = circles[f"pin {pin.name}"]
        assert float(circle.get("cx", "nan")) == pytest.approx(1e3 * pin.x, abs=1e-3)
        assert float(circle.get("cy", "nan")) == pytest.approx(-1e3 * pin.y, abs=1e-3)
    paths = [p.get("id") for p in root.iter("{http://www.w3.org/2000/svg}path")]
    assert {"plate", "mouth"} <= set(paths)


@pytest.mark.parametrize("name", ["type1", "type2", "ccs2", "type2_plug"])
def test_surfaces_face_outwards_and_keep_holes_open(name: str) -> None:
    entry = PORTS[name]
    for surface in surfaces(entry):
        a, b, c = (surface.vertices[surface.faces[:, i]] for i in range(3))
        facing = np.cross(b - a, c - a)
        assert np.all(np.einsum("ij,ij->i", facing, surface.normals[surface.faces[:, 0]]) > -1e-12)
        if surface.look == "face" and np.ptp(surface.vertices[:, 2]) < 1e-9 and not entry.plug:
            middle = (a + b + c)[:, :2] / 3
            recesses = [rim.outline for rim in entry.of_kind("recess")]
            assert not inside_any(recesses, middle, 1e-5).any()


def test_the_area_of_a_pedestal_is_right() -> None:
    """Triangles of a face with holes add up to the shape's own area."""
    entry = PORTS["type1"]
    core = entry.of_kind("pedestal")[0].outline
    face = next(
        s
        for s in surfaces(entry)
        if s.look == "face" and np.allclose(s.vertices[:, 2], 0.0) and len(s.faces) > 50
    )
    a, b, c = (face.vertices[face.faces[:, i]] for i in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    holes = sum(np.pi * rim.outline.radius**2 for rim in entry.of_kind("recess"))
    assert area == pytest.approx(np.pi * (core.radius - 0.6e-3) ** 2 - holes, rel=0.01)


def test_curves_are_the_outlines_without_hidden_parts() -> None:
    model = curves(PORTS["ccs2"], 0.001)
    mouths = [rim.outline for rim in PORTS["ccs2"].of_kind("mouth")]
    on_mouth = np.array([model.rims[k].kind == "mouth" for k in model.rim])
    assert not inside_any(mouths, model.points[on_mouth, :2], 1e-4).any()
    assert np.allclose(np.linalg.norm(model.normals, axis=1), 1.0)


@pytest.mark.parametrize("name", list(PORTS))
def test_a_drawing_shows_each_mouth_where_it_is_and_nothing_across(name):
    """Mouths that do not meet are two lines; as one, they were a fan from one to the other."""
    outlines = [rim.outline for rim in PORTS[name].of_kind("mouth")]
    path = drawing(PORTS[name]).split('<path id="mouth" d="')[1].split('"')[0]
    lines = [line.strip().rstrip("Z").split("L") for line in path.split("M")[1:]]
    loops = [np.array([[float(v) for v in p.split(",")] for p in line]) for line in lines]
    border, _ = sample_union(outlines, 0.2e-3)
    border = 1e3 * border * [1.0, -1.0]
    for loop in loops:  # also between its points, and back to its beginning
        ends = np.roll(loop, -1, axis=0)
        for s in np.linspace(0.0, 1.0, 9):
            away = np.linalg.norm((loop + s * (ends - loop))[:, None] - border, axis=2).min(axis=1)
            assert away.max() < 0.6
    drawn_there = np.concatenate(loops)
    assert np.linalg.norm(border[:, None] - drawn_there, axis=2).min(axis=1).max() < 0.6

"""What the other renderers share, with a renderer that paints a disc for each joint it is given."""

import importlib.util
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from armsight.geometry.pose import inverse, make_pose, transform
from armsight.recognition.data import LabelledSet

FILE = Path(__file__).resolve().parents[3] / "scripts" / "renderers" / "sets.py"


def sets():
    spec = importlib.util.spec_from_file_location("sets", FILE)
    module = importlib.util.module_from_spec(spec)
    sys.modules["sets"] = module
    spec.loader.exec_module(module)
    return module


SETS = sets()


class Discs:
    """A bare floor; a link is a disc at its frame."""

    made = 0

    def __init__(self, samples):
        self.samples, self.links_at = samples, np.empty((0, 3))
        type(self).made += 1

    def place(self, recipe, rng):
        corners = np.array([[-3.0, -3.0, 0.0], [3.0, 3.0, 3.0]])
        return SETS.Place("floor", corners, make_pose(None, (0.1, 0.2, 0.5)), [])

    def arm(self, recipe, arm, T_world_link, rng):
        self.links_at = T_world_link[:, :3, 3]

    def tool(self, T_world_flange, rng):
        return "none"

    def before(self, eye, target, span, rng):
        pass

    def links(self, view):
        lens = view.lens
        out = np.zeros((lens.height, lens.width), np.uint8)
        seen = transform(inverse(view.T_world_camera), self.links_at)
        for k, (pixel, depth) in enumerate(zip(lens.project(seen), seen[:, 2])):
            if depth > 0:
                cv2.circle(out, tuple(round(float(v)) for v in pixel), 9, k + 1, -1)
        return out

    def picture(self, view, recipe, index, rng):
        return np.full((view.lens.height, view.lens.width, 3), self.samples, np.uint8)


def rendered(monkeypatch, out, *more):
    words = ["render.py", "--out", str(out), "--set", "wild", "--robots", "ur3", "none", "unknown"]
    words += ["--count", "2", "--shard", "3", "--size", "160x120", "--seed", "4", *more]
    monkeypatch.setattr(sys, "argv", words)
    return SETS.main("discs 1", 99, 77, Discs, "Discs.")


def test_labels_are_where_a_renderer_was_told_that_the_arm_is(monkeypatch, tmp_path):
    assert rendered(monkeypatch, tmp_path / "set") == 0
    held = LabelledSet.open(tmp_path / "set")
    assert [row.robot for row in held.rows] == ["ur3", "none", "unknown"] * 2
    for sample in held:
        K = sample.K
        assert K[0, 0] == K[1, 1]
        assert (K[0, 2], K[1, 2]) == (79.5, 59.5)
        assert sample.image.mean() == pytest.approx(77, abs=1)
        if sample.robot == "none":
            assert not sample.mask.any()
            continue
        u, v = (K @ sample.joints_camera[-1])[:2] / sample.joints_camera[-1][2]
        if 0 <= round(u) < 160 and 0 <= round(v) < 120:
            assert sample.link_ids[round(v), round(u)] == len(sample.q) + 1


def test_a_set_that_was_begun_goes_on_and_one_of_another_seed_does_not(monkeypatch, tmp_path):
    out = tmp_path / "set"
    assert rendered(monkeypatch, out) == 0
    before = {file: file.read_bytes() for file in out.rglob("*") if file.is_file()}
    last = out / "shards" / "00001"
    for file in sorted(last.rglob("*"), reverse=True):
        file.unlink() if file.is_file() else file.rmdir()
    last.rmdir()
    assert rendered(monkeypatch, out) == 0
    assert {file: file.read_bytes() for file in out.rglob("*") if file.is_file()} == before
    made = Discs.made
    assert rendered(monkeypatch, out, "--seed", "5") == 1  # says so, draws nothing
    assert Discs.made == made

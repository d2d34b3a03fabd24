"""Any task's face on the page: words, figures, curves, pictures, marks and buttons come and go."""

from __future__ import annotations

import numpy as np
import pytest
from page_fakes import FakeSession, make_face
from page_watching import wait_for, watching

from armsight.motion.face import EllipsoidMark, FrameMark, PointsMark, Trace
from armsight.viewer import LivePage
from armsight.viewer.face import columns, fitted, words


def panel(page: LivePage):
    return page._panels._face


def nodes(page: LivePage) -> dict[str, object]:
    return {name: node.handle for (_, name), node in page._scene.marks._nodes.items()}


def test_words_are_escaped_and_old_faces_are_said_to_be():
    shown = make_face(10.0)
    text = words(shown, 10.1)
    assert "approach &lt;slow&gt;" in text
    assert "target &amp; arm are 12.3 mm apart" in text
    assert "12.34 mm" in text
    assert "– deg" in text
    assert "said" not in text
    assert "said 4.0 s ago" in words(shown, 14.0)


def test_curves_of_one_plot_share_their_times():
    a = Trace("a", "mm", np.array([0.0, 1.0, 2.0]), np.array([1.0, 2.0, 3.0]))
    b = Trace("b", "mm", np.array([1.0, 2.0]), np.array([20.0, np.nan]))
    times, first, second = columns([a, b])
    np.testing.assert_array_equal(times, [-2.0, -1.0, 0.0])
    np.testing.assert_array_equal(first, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(second, [20.0, 20.0, 20.0])  # it has one value
    late = Trace("c", "N", np.array([0.0, 1.0, 2.0, 3.0]), np.array([np.nan, 4.0, 5.0, np.nan]))
    times, values = columns([late])  # the plot draws nothing where a single value is NaN
    np.testing.assert_array_equal(times, [-2.0, -1.0])
    np.testing.assert_array_equal(values, [4.0, 5.0])
    long = np.linspace(0.0, 30.0, 1000)
    times, values = columns([Trace("a", "", long, long)])
    assert len(times) <= 300
    assert times[-1] == 0.0
    assert values[-1] == 30.0


def test_large_pictures_are_sent_smaller():
    assert fitted(np.zeros((100, 640, 3), np.uint8)).shape == (100, 640, 3)
    assert fitted(np.zeros((1080, 1920, 3), np.uint8)).shape == (360, 640, 3)


def test_the_face_comes_changes_and_goes(session: FakeSession, page: LivePage) -> None:
    with watching(page):
        session.step(1.0)
        page.update(1.0)
        assert not panel(page)._folder.visible
        session.step(1.1, face=make_face(1.1))
        page._health_shown = -np.inf
        page.update(1.1)
        assert panel(page)._folder.visible
        assert panel(page)._folder.label == "Task: keep_above"
        assert set(panel(page)._buttons) == {"go", "skip"}
        assert panel(page)._buttons["skip"].disabled
        assert {names for _, names in panel(page)._plots} == {("distance", "bound"), ("tilt",)}
        assert set(panel(page)._pictures) == {"what it sees"}
        assert set(nodes(page)) == {"corners", "motion", "target", "doubt", "keep out"}
        # A part that the next face lacks goes, what stays is moved, not made anew.
        kept = nodes(page)["target"]
        moved = np.eye(4)
        moved[:3, 3] = [0.1, 0.2, 0.3]
        marks = (FrameMark("target", moved, 0.15), PointsMark("corners", np.zeros((3, 3)), 0.02))
        session.step(1.2, face=make_face(1.2, marks=marks, buttons=(), pictures=(), curves=()))
        page._health_shown = -np.inf
        page.update(1.2)
        assert set(nodes(page)) == {"target", "corners"}
        assert nodes(page)["target"] is kept
        np.testing.assert_allclose(kept.position, [0.1, 0.2, 0.3])
        assert not panel(page)._buttons
        assert not panel(page)._plots
        assert not panel(page)._pictures
        session.step(1.3)
        page.update(1.3)
        assert not panel(page)._folder.visible
        assert not nodes(page)


def test_the_ellipsoid_is_as_long_as_the_doubt(session: FakeSession, page: LivePage) -> None:
    """Along each axis of the covariance it ends at two standard deviations."""
    sigma = np.array([0.03, 0.02, 0.01])
    mark = EllipsoidMark.of("doubt", np.zeros(3), np.diag(sigma**2))
    with watching(page):
        session.step(1.0, face=make_face(1.0, marks=(mark,)))
        page.update(1.0)
        handle = nodes(page)["doubt"]
        assert sorted(handle.scale) == pytest.approx(sorted(2.0 * sigma))


def test_a_layer_hides_all_marks(session: FakeSession, page: LivePage) -> None:
    layer = next(layer for layer in page._scene.layers() if layer.label == "Task")
    with watching(page):
        session.step(1.0, face=make_face(1.0))
        page.update(1.0)
        layer.switch(False)
        assert page._scene.marks._handle.visible is False
        session.step(1.1, face=make_face(1.1))
        page.update(1.1)
        assert page._scene.marks._handle.visible is False
        layer.switch(True)
        assert page._scene.marks._handle.visible is True


def test_names_from_a_task_cannot_reach_other_nodes(session: FakeSession, page: LivePage) -> None:
    """A mark named like a path of the scene is still only a mark."""
    mark = PointsMark("../../robot/link_0", np.zeros((1, 3)))
    with watching(page):
        session.step(1.0, face=make_face(1.0, marks=(mark,)))
        page.update(1.0)
        (handle,) = nodes(page).values()
        assert handle.name.startswith("/base/task/PointsMark_0")


def test_buttons_press(session: FakeSession, page: LivePage) -> None:
    with watching(page):
        session.step(1.0, face=make_face(1.0))
        page.update(1.0)
        for callback in panel(page)._buttons["go"]._impl.update_cb:
            callback(None)
        wait_for(lambda: ("press", "go") in session.asked)


def test_a_press_that_meets_a_button_switched_off_is_none(
    session: FakeSession, page: LivePage
) -> None:
    """A browser may have shown it as it was a moment ago."""
    with watching(page):
        session.step(1.0, face=make_face(1.0))
        page.update(1.0)
        button = panel(page)._buttons["go"]
        button.disabled = True
        for callback in button._impl.update_cb:
            callback(None)
    assert ("press", "go") not in session.asked


def test_of_names_on_each_other_the_first_is_shown(session: FakeSession, page: LivePage) -> None:
    def labels(now: float, apart: float) -> dict[str, bool]:
        marks = tuple(
            PointsMark(name, np.array([[x, 0.0, 0.5]]), 0.01, (9, 9, 9))
            for name, x in (("target", 0.0), ("prediction", apart), ("far", 1.0))
        )
        session.step(now, face=make_face(now, marks=marks))
        page.update(now)
        nodes = page._scene.marks._nodes
        return {name: node.label.visible for (_, name), node in nodes.items()}

    with watching(page):
        assert labels(1.0, 0.03) == {"target": True, "prediction": False, "far": True}
        assert labels(1.3, 0.30) == {"target": True, "prediction": True, "far": True}

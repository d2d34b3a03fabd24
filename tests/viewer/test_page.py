"""The page: what it sends, what it remembers, what it passes on, and what it never does."""

from __future__ import annotations

import threading
from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from page_fakes import FakeSession, make_guard, make_snapshot, make_view
from page_watching import wait_for, watching
from viser import _messages as wire

from armsight.devices.world import MovingSurfaces
from armsight.errors import UsageError
from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Surface
from armsight.motion.data import GuardMode
from armsight.recording.no_robot import no_robot
from armsight.runtime.view import SessionView
from armsight.viewer import LivePage, colors
from armsight.viewer.page import draggable


def sent(page: LivePage, kind: type | None = None) -> list[object]:
    """Messages that the server keeps for those who come later."""
    buffer = page._server._websock_server._broadcast_buffer
    messages = list(buffer.message_from_id.values())
    return messages if kind is None else [m for m in messages if isinstance(m, kind)]


def counter(page: LivePage) -> int:
    return page._server._websock_server._broadcast_buffer.message_counter


def words(page: LivePage, key: str) -> str:
    return str(page._panels._texts[key].content)


def test_nothing_is_sent_while_nobody_looks(page: LivePage, session: FakeSession) -> None:
    before = counter(page)
    for i in range(20):
        session.step(0.1 * i)
        page.update(0.1 * i)
    assert counter(page) == before


def test_a_newcomer_sees_the_present(page: LivePage, session: FakeSession) -> None:
    session.step(3.0)
    with watching(page):
        wait_for(lambda: "slowed" in words(page, "banner"))
        assert "t = 3.0 s" in words(page, "figures")
        assert len(sent(page, wire.PointCloudMessage)) == 1


def test_what_did_not_change_is_not_sent_again(page: LivePage, session: FakeSession) -> None:
    with watching(page):
        session.step(1.0)
        page.update(1.0)
        page.update(1.0)
        page.update(1.0)
        with page._lock:  # nobody else shows: not the look for the newcomer, which may come late
            page._panels.update_health(session.shown, "")
            page._scene.update(session.shown)
            page._panels.update(session.shown, 0.1, "")
            before = counter(page)
            for _ in range(5):
                page._scene.update(session.shown)
                page._panels.update(session.shown, 0.1, "")
            assert counter(page) - before <= 5  # the line's points, which viser compares by itself


def test_buffers_stay_bounded(page: LivePage, session: FakeSession) -> None:
    with watching(page) as client:
        for i in range(150):
            session.step(0.1 * i)
            page.update(0.1 * i)
            if i == 40:
                kept = len(sent(page))
            if i % 20 == 0:
                client.recv()
        assert len(sent(page)) <= kept + 10
    assert all(len(column) <= 302 for column in page._panels._distances.columns())


def test_clouds_and_voxels_are_updated_in_place(page: LivePage, session: FakeSession) -> None:
    with watching(page):
        session.step(1.0)
        page.update(1.0)
        handles = page._scene.cloud._handle, page._scene.voxels._handle
        session.step(1.2)
        page.update(1.2)
        assert (page._scene.cloud._handle, page._scene.voxels._handle) == handles
        points = np.asarray(page._scene.cloud._handle.points)[: len(session.shown.snapshot.cloud)]
        np.testing.assert_allclose(points, session.shown.snapshot.cloud, atol=1e-3)
        snapshot = make_snapshot(99, 1.3, points=0, voxels=0)
        session.shown = replace(session.shown, now=1.3, snapshot=snapshot)
        page.update(1.3)
        assert not page._scene.cloud._handle.visible
        session.step(1.4)
        page.update(1.4)
        assert page._scene.cloud._handle.visible


def test_layers_hide_and_come_back(page: LivePage, session: FakeSession) -> None:
    with watching(page):
        session.step(1.0)
        page.update(1.0)
        for layer in page._scene.layers():
            layer.switch(not layer.on)
        session.step(1.1)
        page.update(1.1)
        assert not page._scene.cloud._handle.visible
        assert not page._scene.planned._handle.visible
        assert page._scene.hazards._handle.visible
        for layer in page._scene.layers():
            layer.switch(layer.on)
        assert page._scene.planned._handle.visible


def test_people_come_and_go(page: LivePage, session: FakeSession) -> None:
    with watching(page):
        session.step(1.0)
        page.update(1.0)
        assert set(page._scene.movers._handles) == {"box", "sphere", "cylinder"}
        session.step(1.1, movers=session.shown.movers[:1])
        page.update(1.1)
        assert set(page._scene.movers._handles) == {"sphere"}
        session.step(1.2, movers=())
        page.update(1.2)
        assert not page._scene.movers._handles
        session.step(1.3)
        page.update(1.3)
        assert len(page._scene.movers._handles) == 3


def test_the_robot_stands_where_its_joints_say(page: LivePage, session: FakeSession) -> None:
    from armsight.robots.kinematics import link_poses

    with watching(page):
        session.step(2.0)
        page.update(2.0)
        poses = link_poses(session.cell.robot, session.shown.joints.position)
        for link, T in zip(page._scene.robot._links, poses, strict=True):
            np.testing.assert_allclose(link.handle.position, T[:3, 3], atol=1e-4)


def test_a_carried_camera_moves_with_the_flange(page: LivePage, session: FakeSession) -> None:
    from armsight.robots.kinematics import flange_pose

    with watching(page):
        session.step(2.0)
        page.update(2.0)
        T = flange_pose(session.cell.robot, session.shown.joints.position)
        wrist = page._scene.cameras["wrist"]
        np.testing.assert_allclose(wrist._handle.position, T[:3, 3], atol=1e-4)


def test_a_posed_frame_moves_its_camera(page: LivePage, session: FakeSession) -> None:
    with watching(page):
        session.step(2.0)
        [frame] = session.shown.frames
        pose = np.eye(4)
        pose[:3, 3] = [1.0, 2.0, 3.0]
        session.shown = replace(session.shown, frames=(replace(frame, T_base_camera=pose),))
        page.update(2.0)
        np.testing.assert_allclose(page._scene.cameras["<left>"]._handle.position, [1, 2, 3])


@pytest.mark.parametrize(
    "view",
    [
        SessionView(0.0, True, 1.0, None, None, None),
        make_view(guard=None),
        make_view(snapshot=None),
        make_view(joints=None, frames=(), movers=(), health=()),
        make_view(guard=make_guard(1.0, distance=np.inf, nearest_hazard=None, nearest_body=None)),
        make_view(guard=make_guard(1.0, path=np.zeros((1, 6)), executed=None, mode=GuardMode.IDLE)),
        make_view(guard=make_guard(1.0, protective_distance=np.nan, distance=np.nan)),
    ],
)
def test_views_with_holes_are_shown(
    page: LivePage, session: FakeSession, view: SessionView
) -> None:
    with watching(page):
        session.shown = view
        page.update(view.now)
        page._look()
        assert page.problem == ""


def test_a_reset_starts_the_plots_anew(page: LivePage, session: FakeSession) -> None:
    for i in range(30):
        session.step(0.1 * i)
        page.update(0.1 * i)
    assert page._panels._distances.columns()[0][0] == pytest.approx(-2.9)
    session.step(0.0)
    page.update(0.0)
    assert len(page._panels._distances.columns()[0]) == 2


def test_buttons_reach_the_session(page: LivePage, session: FakeSession) -> None:
    page._panels._controls.pause()
    page._panels._controls.go_on()
    page._reset()
    page._panels._controls.declare_empty()
    assert session.asked == ["pause", "resume", "reset", "resume", ("empty",)]


def test_who_presses_pause_twice_does_not_go_on(page: LivePage, session: FakeSession) -> None:
    """It was one button that went on when pressed again: by the same hand, or by two people."""
    gui = page._server.gui
    buttons = {h.label: h for h in gui._gui_input_handle_from_uuid.values() if hasattr(h, "label")}
    with watching(page):
        for running in (True, False, False):
            session.shown = replace(session.shown, running=running)
            page.update(1.0)
            assert buttons["Go on"].disabled is running
            assert not buttons["Pause"].disabled
            for press in buttons["Pause"]._impl.update_cb:
                press(SimpleNamespace())
    assert session.asked == ["pause"] * 3


def test_dragging_reaches_the_session(page: LivePage, session: FakeSession) -> None:
    assert draggable(session.cell) == ("helper", "ball")
    page._choose_dragged("ball")
    assert page._gizmo is not None
    page._gizmo.position = (0.5, 0.25, 1.0)
    page._move_dragged("ball")
    page._gizmo.position = (0.5, np.nan, 1.0)
    page._move_dragged("ball")
    assert session.asked == [("drag", "ball", (0.5, 0.25, 1.0))]
    page._choose_dragged("")
    assert page._gizmo is None


def test_who_chooses_nothing_while_another_page_chooses_has_the_last_word(
    page: LivePage, monkeypatch: pytest.MonkeyPatch
) -> None:
    began, go_on, place = threading.Event(), threading.Event(), page._dragged_from

    def slow(name: str) -> np.ndarray:
        began.set()
        go_on.wait(10.0)
        return place(name)

    monkeypatch.setattr(page, "_dragged_from", slow)
    first = threading.Thread(target=page._choose_dragged, args=("ball",))
    first.start()
    assert began.wait(10.0)
    second = threading.Thread(target=page._choose_dragged, args=("",))
    second.start()
    second.join(0.3)
    go_on.set()
    first.join(10.0)
    second.join(10.0)
    assert page._gizmo is None


def test_only_what_may_be_dragged_gets_arrows(page: LivePage) -> None:
    """Any name that a browser made up had some, in the middle of the room."""
    page._choose_dragged("nobody")
    assert page._gizmo is None


def test_browsers_give_values_and_nothing_else(page: LivePage, session: FakeSession) -> None:
    """They could set all that a button has, the functions that it calls as well, for every page."""
    gui = page._server.gui
    buttons = {h.label: h for h in gui._gui_input_handle_from_uuid.values() if hasattr(h, "label")}
    pause, go_on = buttons["Pause"], buttons["Go on"]
    name = pause._impl.uuid

    def update(uuid: str, **updates: object) -> bytes:
        message = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates}
        return msgspec.msgpack.encode(message)

    file = {
        "type": "FileTransferStartUpload",
        "source_component_uuid": name,
        "transfer_uuid": "x",
        "filename": "f",
        "mime_type": "text/plain",
        "part_count": 1000,
        "size_bytes": 10**9,
    }
    with watching(page) as client:
        client.send(update(name, update_cb=[], label="Go on", removed=True))
        client.send(update(go_on._impl.uuid, disabled=False, value=True))
        client.send(msgspec.msgpack.encode(file))
        client.send(update(name, value=True))
        wait_for(lambda: session.asked)
        assert session.asked == ["pause"]
        assert (pause.label, go_on.disabled) == ("Pause", True)
        assert not gui._current_file_upload_states


def test_the_arrows_stand_where_the_dragged_car_is_led_from(page: LivePage) -> None:
    """They stood in the middle of its body, so that a touch made it leap by 30 cm."""
    T = make_pose(None, (0.92, 0.05, 0.85))
    page._cell.world.car = SimpleNamespace(name="car", T_world_socket=T)
    page._draggable = ("car",)
    page._choose_dragged("car")
    assert page._gizmo is not None
    assert page._gizmo.position == pytest.approx(T[:3, 3])


def test_a_camera_s_stand_can_be_pulled_from_where_it_truly_is(page: LivePage) -> None:
    T = make_pose(None, (1.2, -0.4, 1.5))
    standing, carried = (
        SimpleNamespace(info=SimpleNamespace(name=name, mounted_on=on), T_mount_camera=T)
        for name, on in (("left", "base"), ("wrist", "flange"))
    )
    page._cell.world.cameras = (standing, carried)
    assert draggable(page._cell) == ("helper", "ball", "left")
    page._draggable = draggable(page._cell)
    page._choose_dragged("left")
    assert page._gizmo is not None
    assert page._gizmo.position == pytest.approx(T[:3, 3])


def test_a_refused_drag_is_told_not_raised(
    page: LivePage, session: FakeSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(name: str, position_world: object) -> None:
        raise UsageError(f"{name} is part of a recording")

    monkeypatch.setattr(session, "drag", refuse)
    page._choose_dragged("ball")
    page._move_dragged("ball")
    assert page.problem == "ball is part of a recording"


def test_a_silent_loop_is_told(page: LivePage, session: FakeSession) -> None:
    session.step(1.0)
    page.update(1.0)
    with watching(page):
        wait_for(lambda: "the loop stands still" in words(page, "banner"))
        session.shown = replace(session.shown, running=False)
        wait_for(lambda: "paused" in words(page, "banner"))


def test_what_the_guard_said_long_ago_is_not_shown_as_of_now(
    page: LivePage, session: FakeSession
) -> None:
    """A loop that goes on without its guard, or without its joints, showed a moving arm's green."""
    green = colors.MODES[GuardMode.PREDICTIVE][1]
    with watching(page):
        session.step(1.0, guard=make_guard(1.0, mode=GuardMode.PREDICTIVE))
        page.update(1.0)
        assert green in words(page, "banner")
        assert "m/s" in words(page, "figures")
        session.shown = replace(session.shown, now=1.8)
        page.update(1.8)
        assert green not in words(page, "banner")
        assert "the guard has said nothing for 0.8 s" in words(page, "banner")
        assert "m/s" not in words(page, "figures")
        page.update(1.8)
        wait_for(lambda: "the loop stands still" in words(page, "banner"))
        assert green not in words(page, "banner")
        assert "m/s" not in words(page, "figures")


def test_a_browser_is_told_again_and_again_that_somebody_is_there(
    page: LivePage, session: FakeSession
) -> None:
    with watching(page):
        page.update(1.0)
        first = words(page, "pulse")
        wait_for(lambda: words(page, "pulse") != first)  # also of a loop that is silent


def test_values_that_are_not_known_leave_the_plots_whole(
    page: LivePage, session: FakeSession
) -> None:
    for i in range(30):
        session.step(0.1 * i)
        if i == 10:
            guard = make_guard(1.0, distance=np.nan)
            session.shown = replace(session.shown, guard=guard, joints=None)
        page.update(0.1 * i)
    for plotted in (page._panels._distances, page._panels._speeds):
        assert len(plotted.columns()[0]) == 29
        assert np.isfinite(plotted.columns()).all()


def test_a_cell_without_an_arm_has_a_page() -> None:
    session = FakeSession()
    session.cell.robot = no_robot()
    session.shown = make_view(joints=None, guard=None, movers=())
    page = LivePage(session, port=0)
    try:
        with watching(page):
            page.update(1.0)
            wait_for(lambda: "mapping" in words(page, "banner"))
            assert "occupied voxels" in words(page, "figures")
    finally:
        page.close()


def test_people_in_detail_replace_their_rough_solids(page: LivePage, session: FakeSession) -> None:
    surface = Surface("head", np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]), (1.0, 0.5, 0.2))
    with watching(page):
        session.step(1.0)
        others = (replace(session.shown.movers[0], name="ball"),)
        session.step(1.0, movers=(*session.shown.movers, *others))
        pose = np.eye(4)
        for i in range(3):
            pose = pose.copy()
            pose[0, 3] = 0.1 * i
            body = MovingSurfaces("person/head", (surface,), pose)
            session.shown = replace(session.shown, bodies=(body,))
            page.update(1.0)
        assert set(page._scene.movers._handles) == {"sphere"}  # the ball alone
        frame = page._scene.people._parts["person/head"][1].handle
        np.testing.assert_allclose(frame.position, [0.2, 0.0, 0.0])
        assert len(sent(page, wire.MeshMessage)) == before_meshes(page) + 1
        session.step(2.0)
        page.update(2.0)
        assert not page._scene.people._parts
        assert len(page._scene.movers._handles) == 3


def before_meshes(page: LivePage) -> int:
    """Meshes of the robot and of walls."""
    return sum("/people" not in m.name for m in sent(page, wire.MeshMessage))  # type: ignore[attr-defined]


def test_a_clock_that_cannot_be_turned_has_no_buttons_for_it() -> None:
    """Of a simulation beside real devices: they were there, and ended in a traceback."""
    session = FakeSession()
    session.cell.mixed = True
    page = LivePage(session, port=0)
    try:
        labels = {getattr(h, "label", "") for h in _inputs(page)}
        assert "Pause" in labels
        assert not labels & {"Reset", "Speed"}
    finally:
        page.close()
    session.cell.mixed = False
    page = LivePage(session, port=0)
    try:
        assert {getattr(h, "label", "") for h in _inputs(page)} >= {"Reset", "Speed"}
    finally:
        page.close()


def _inputs(page: LivePage) -> list[object]:
    return list(page._server.gui._gui_input_handle_from_uuid.values())

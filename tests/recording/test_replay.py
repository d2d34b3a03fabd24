"""Replays drive the same map; foreign recordings and cut ones are read as far as they go."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recorded_cells import (
    FakeSession,
    camera_info,
    empty_view,
    make_cell,
    make_frame,
    make_joints,
    make_movers,
    make_status,
)

from armsight.devices.data import (
    ArmStatus,
    DeclaredSolids,
    EmptyCell,
    GripperState,
    RgbdFrame,
    Wrench,
)
from armsight.errors import RecordingError, UsageError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, look_at, make_pose
from armsight.geometry.shapes import Solid
from armsight.mapping.config import MappingConfig
from armsight.mapping.snapshot import OCCUPIED
from armsight.motion.data import GuardMode
from armsight.recording import messages
from armsight.recording.description import CellDescription, to_metadata
from armsight.recording.mcap_file import McapReader, McapWriter
from armsight.recording.recorder import Recorder
from armsight.recording.replay import _as_recorded, open_recording
from armsight.recording.replay_parts import HoldAtEnd, replay_parts
from armsight.runtime.config import SessionConfig, SessionMode
from armsight.runtime.session import Session
from armsight.runtime.view import SessionView
from armsight.workcell import Cell, parse_workcell, robot_in
from armsight.workcell.packaged import packaged

SMALL = SessionConfig(
    mapping=MappingConfig(
        lower=(-0.6, -0.6, -0.1),
        upper=(0.6, 0.6, 0.7),
        voxel=0.04,
        far_lower=(0, 0, 0),
        far_upper=(0, 0, 0),
        align=False,
    )
)


class Watcher:
    """Keeps every snapshot that a session shows."""

    name = "watcher"
    period = 0.01

    def __init__(self) -> None:
        self.seen: dict[int, object] = {}

    def attach(self, session: Session) -> None:
        self._view = session.view

    def update(self, now: float) -> None:
        view: SessionView = self._view()
        if view.snapshot is not None:
            self.seen[view.snapshot.sequence] = view.snapshot


def walls(path: Path, rounds: int = 8) -> None:
    """A recording of two cameras that look at a ball moving before a wall."""
    infos = (camera_info("left"), camera_info("right"))
    cell = make_cell(infos)
    recorder = Recorder(path, cell)
    rng = np.random.default_rng(0)
    for i in range(rounds):
        now = 0.1 * i
        for k in range(25):
            at = now + 0.004 * k
            recorder.on_reading(type(make_joints(at, 6, rng))(at, cell.robot.home, np.zeros(6)), at)
            if k == 10:
                for info in infos:
                    rays = info.depth.rays
                    ball = np.hypot(rays[..., 0] - 0.02 * i, rays[..., 1]) < 0.1
                    depth = np.where(ball, 1.6, 2.2).astype(np.float32)
                    recorder.on_reading(RgbdFrame(info.name, i, at - 0.03, at, depth), at)
    recorder.close()


def run(cell: Cell, seconds: float) -> dict[int, object]:
    watcher = Watcher()
    session = Session(cell, None, make=replay_parts, observers=[watcher], config=SMALL)
    session.run(seconds)
    return watcher.seen


def same(a: object, b: object) -> bool:
    names = ("state", "distance", "last_occupied", "hazards", "hazard_unknown", "cloud")
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in names)


def test_a_replay_drives_the_map_and_is_the_same_every_time(tmp_path: Path) -> None:
    walls(tmp_path / "a.mcap")
    runs = []
    for _ in range(2):
        with open_recording(tmp_path / "a.mcap") as cell:
            runs.append(run(cell, 0.9))
    assert len(runs[0]) > 8
    assert runs[0].keys() == runs[1].keys()
    assert all(same(runs[0][k], runs[1][k]) for k in runs[0])
    newest = runs[0][max(runs[0])]
    assert np.count_nonzero(newest.state == OCCUPIED) > 0  # type: ignore[attr-defined]


def test_a_recorded_replay_replays_the_same(tmp_path: Path) -> None:
    """What sensing takes in is recorded once, at its moment: both make the same map."""
    walls(tmp_path / "a.mcap")
    with open_recording(tmp_path / "a.mcap") as cell:
        recorder = Recorder(tmp_path / "b.mcap", cell)
        watcher = Watcher()
        session = Session(
            cell, None, make=replay_parts, observers=[recorder, watcher], config=SMALL
        )
        session.run(0.9)
        recorder.close()
        deliveries = list(cell.world.source.deliveries())
    with open_recording(tmp_path / "b.mcap") as cell:
        again = [d for d in cell.world.source.deliveries() if isinstance(d.item, RgbdFrame)]
        copy = run(cell, 0.9)
    first = [d for d in deliveries if isinstance(d.item, RgbdFrame)]
    assert len(again) == len(first)
    for a, b in zip(first, again):
        assert a.item.depth.tobytes() == b.item.depth.tobytes()
        assert a.item.stamp == b.item.stamp
    original = [s for _, s in sorted(watcher.seen.items())]
    copied = [s for _, s in sorted(copy.items())]
    assert same(original[-1], copied[-1])


def test_the_word_that_the_cell_is_empty_is_replayed(tmp_path: Path) -> None:
    """Once, at its time, whether it was given at the start or later; the map judges it anew."""
    walls(tmp_path / "a.mcap")
    for name, mode, later in (
        ("start", SessionMode(cell_is_empty=True), ()),
        ("later", None, (0.5,)),
    ):
        with open_recording(tmp_path / "a.mcap") as cell:
            recorder = Recorder(tmp_path / f"{name}.mcap", cell)
            session = Session(
                cell, None, make=replay_parts, observers=[recorder], config=SMALL, mode=mode
            )
            for until in later:
                session.run(until)
                session.declare_empty()
            session.run(0.4)
            recorder.close()
            emptiness = session.snapshot().emptiness
        assert emptiness.said or emptiness.waiting
        with open_recording(tmp_path / f"{name}.mcap") as cell:
            words = [
                d.item for d in cell.world.source.deliveries() if isinstance(d.item, EmptyCell)
            ]
            assert [w.stamp for w in words] == pytest.approx(list(later) or [0.0], abs=0.01)
            session = Session(cell, None, make=replay_parts, config=SMALL)
            session.run(0.4 + sum(later))
            assert session.snapshot().emptiness == emptiness


def test_solids_that_came_and_went_are_replayed(tmp_path: Path) -> None:
    walls(tmp_path / "a.mcap")
    with open_recording(tmp_path / "a.mcap") as cell:
        T = cell.T_world_base
        where = T @ make_pose(None, np.array([0.4, 0.1, 0.3]))
        box = Solid("box", "box", (0.2, 0.3, 0.4), where, (0.1, 0.2, 0.3), "black_plastic", 0.04)
        recorder = Recorder(tmp_path / "b.mcap", cell)
        session = Session(cell, None, make=replay_parts, observers=[recorder], config=SMALL)
        session.run(0.2)
        session.declare_solids("fixture", [box])
        session.run(0.2)
        told = session.snapshot().declared
        session.withdraw_solids("fixture")
        with pytest.raises(UsageError, match="declared are none"):
            session.withdraw_solids("fixture")
        session.run(0.2)
        assert session.snapshot().declared == ()
        recorder.close()
    assert [d.name for d in told] == ["fixture"]
    with open_recording(tmp_path / "b.mcap") as cell:
        deliveries = [d.item for d in cell.world.source.deliveries()]
        words = [d for d in deliveries if isinstance(d, DeclaredSolids)]
        assert [len(w.solids) for w in words] == [1, 0]
        again = words[0].solids[0]
        assert (again.name, again.kind, again.size) == (box.name, box.kind, box.size)
        assert (again.color, again.material, again.coarse) == (box.color, box.material, 0.04)
        np.testing.assert_allclose(T @ again.T_frame_solid, where, atol=1e-12)
        session = Session(cell, None, make=replay_parts, config=SMALL)
        session.run(0.38)
        assert [(d.name, d.taken) for d in session.snapshot().declared] == [
            (d.name, d.taken) for d in told
        ]


def test_simulated_and_replayed_maps_agree(tmp_path: Path, gl: str) -> None:
    """The real thing: a simulated cell under its own guard, and its recording."""
    from armsight.workcell import load_workcell, open_cell

    file = Path(__file__).resolve().parents[2] / "workcells" / "ur5_four_cameras.toml"
    live, played = Watcher(), Watcher()
    with open_cell(load_workcell(file), seed=1) as cell:
        recorder = Recorder(tmp_path / "a.mcap", cell)
        session = Session(cell, None, observers=[recorder, live])
        session._warm = True  # nothing moves here: no need to compile ahead
        session.run(0.5)
        recorder.close()
        status = session.view().guard
    with open_recording(tmp_path / "a.mcap") as cell:
        assert cell.workcell.name == "ur5_four_cameras"
        session = Session(cell, None, make=replay_parts, observers=[played])
        session.run(0.5)
        view = session.view()
    assert live.seen.keys() == played.seen.keys()
    a, b = live.seen[max(live.seen)], played.seen[max(played.seen)]
    # Stamps are rounded to the nanosecond, which may tip a voxel or two.
    for name in ("state", "hazard_unknown"):
        x, y = getattr(a, name), getattr(b, name)
        assert x.shape == y.shape
        assert np.count_nonzero(x != y) <= 1e-4 * x.size, name
    assert view.bodies
    assert view.guard is not None
    assert status is not None
    assert view.guard.mode is status.mode
    assert view.guard.reason == status.reason


def test_the_page_holds_at_the_end(tmp_path: Path) -> None:
    walls(tmp_path / "a.mcap", 3)
    with open_recording(tmp_path / "a.mcap") as cell:
        hold = HoldAtEnd()
        session = Session(cell, None, make=replay_parts, observers=[hold], config=SMALL)
        paused: list[float] = []
        pause = session.pause

        def remember() -> None:
            paused.append(session.now())
            pause()
            session.stop()

        session.pause = remember  # type: ignore[method-assign]
        session.run(5.0)
        assert paused
        assert 0.296 <= paused[0] < 0.5
        assert session.view().guard.mode is GuardMode.IDLE


def test_a_recording_cannot_be_dragged_about(tmp_path: Path) -> None:
    walls(tmp_path / "a.mcap", 2)
    cell = open_recording(tmp_path / "a.mcap")
    with cell, pytest.raises(UsageError, match="cannot be dragged"):
        cell.world.drag("ball", np.zeros(3))


def test_a_cut_recording_says_how_far_it_goes(tmp_path: Path) -> None:
    walls(tmp_path / "a.mcap", 8)
    whole = (tmp_path / "a.mcap").read_bytes()
    cut = tmp_path / "b.mcap.partial"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(RecordingError, match=r"b\.mcap\.partial lies beside it"):
        open_recording(tmp_path / "b.mcap")
    try:
        cell = open_recording(cut)
    except RecordingError as error:  # the one chunk was cut: nothing to show, and it says so
        assert "no depth images" in str(error) or "torn" in str(error)  # noqa: PT017
        return
    with cell:
        assert "b.mcap.partial was cut short" in cell.world.note
        run(cell, 0.9)


@pytest.mark.parametrize("base", ["base", "map"])
@pytest.mark.parametrize("moving", [False, True])
def test_a_foreign_recording_is_understood(tmp_path: Path, base: str, moving: bool) -> None:
    """As a RealSense driver and ``ros2 bag record`` would write it, seconds since 1970 and all."""
    info = camera_info("c", 0.02)
    T = look_at([1.0, 0.2, 0.9], [0.0, 0.0, 0.0])
    T_mount_lens = make_pose(None, [0.0, 0.01, 0.02])
    writer = McapWriter(tmp_path / "a.mcap")
    epoch = 1_790_000_000.0
    rng = np.random.default_rng(0)
    frames = []

    def write(topic: str, kind: str, data: bytes, at: float) -> None:
        writer.write(topic, kind, data, messages.to_ns(at), messages.to_ns(at))

    tree = [("cam_link", "cam_depth_optical_frame", T_mount_lens)]
    if not moving:
        tree.append((base, "cam_link", T @ inverse(T_mount_lens)))
    write("/tf_static", messages.TRANSFORMS, messages.encode_transforms(tree, epoch), epoch)
    for i in range(5):
        at = epoch + 0.1 * i
        shift = make_pose(None, [0.01 * i, 0.0, 0.0])
        if moving:
            pose = shift @ T @ inverse(T_mount_lens)
            data = messages.encode_transforms([(base, "cam_link", pose)], at)
            write("/tf", messages.TRANSFORMS, data, at)
        lens = messages.encode_camera_info(info.depth, at, "cam_depth_optical_frame")
        write("/cam/depth/camera_info", messages.CAMERA_INFO, lens, at)
        frames.append(make_frame(info, i, at, rng).depth)
        image = messages.encode_depth(frames[-1], at, "cam_depth_optical_frame")
        write("/cam/depth/image_rect_raw", messages.IMAGE, image, at)
    writer.close()
    with open_recording(tmp_path / "a.mcap") as cell:
        [camera] = cell.cameras
        assert cell.robot.n == 0
        assert camera.info.name == "cam"
        assert camera.info.depth == info.depth
        np.testing.assert_allclose(camera.info.T_mount_camera, T, atol=1e-9)
        assert cell.clock.now() == 0.0
        for i in range(5):
            cell.world.advance(0.1 * i + 0.01)
            frame = camera.read()
            assert frame.depth.tobytes() == frames[i].tobytes()
            assert abs(frame.stamp - 0.1 * i) < 1e-6
            if moving:
                np.testing.assert_allclose(frame.T_base_camera[:3, 3], T[:3, 3] + [0.01 * i, 0, 0])
            else:
                assert frame.T_base_camera is None
    # It has no joints either, and none are waited for: what it shows is in the map.
    with open_recording(tmp_path / "a.mcap") as cell:
        seen = run(cell, 0.6)
    last = seen[max(seen)]
    assert sum(camera.frames for camera in last.cameras) >= 4


def test_a_bag_of_many_topics_without_pictures_is_told_in_a_line(tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap")
    for i in range(100):
        writer.write(f"/t{i}", messages.STRING, messages.encode_string("hello"), 0, 0)
    writer.close()
    with pytest.raises(RecordingError, match=r"no depth images.*and 88 more\)$"):
        open_recording(tmp_path / "a.mcap")


@pytest.mark.parametrize(
    ("topics", "told"),
    [
        ((), "no depth images"),
        (("image",), "no camera_info beside it"),
        (("image", "info"), "do not say where"),
    ],
)
def test_foreign_recordings_that_lack_something(
    tmp_path: Path, topics: tuple[str, ...], told: str
) -> None:
    info = camera_info("c")
    writer = McapWriter(tmp_path / "a.mcap")
    writer.write("/chatter", messages.STRING, messages.encode_string("hello"), 0, 0)
    if "info" in topics:
        data = messages.encode_camera_info(info.depth, 0.0, "lens")
        writer.write("/c/depth/camera_info", messages.CAMERA_INFO, data, 0, 0)
    if topics:
        data = messages.encode_depth(np.ones((48, 64), np.float32), 0.0, "lens")
        writer.write("/c/depth/image", messages.IMAGE, data, 0, 0)
    if "info" in topics:
        data = messages.encode_transforms([("base", "elsewhere", np.eye(4))], 0.0)
        writer.write("/tf_static", messages.TRANSFORMS, data, 0, 0)
    writer.close()
    if told == "do not say where":  # without any tree the lens itself is the root, which is fine
        with open_recording(tmp_path / "a.mcap") as cell:
            np.testing.assert_array_equal(cell.cameras[0].info.T_mount_camera, np.eye(4))
        return
    with pytest.raises(RecordingError, match=told):
        open_recording(tmp_path / "a.mcap")


@pytest.mark.parametrize("topic", ["/c/depth/image", "/c/depth/camera_info", "/tf_static"])
def test_a_foreign_message_that_is_none_is_told_with_its_file_and_topic(
    tmp_path: Path, topic: str
) -> None:
    info, kinds = camera_info("c"), {}
    kinds["/c/depth/image"] = messages.IMAGE, messages.encode_depth(np.ones((9, 9)), 0.0, "lens")
    lens = messages.encode_camera_info(info.depth, 0.0, "lens")
    kinds["/c/depth/camera_info"] = messages.CAMERA_INFO, lens
    tree = messages.encode_transforms([("base", "lens", np.eye(4))], 0.0)
    kinds["/tf_static"] = messages.TRANSFORMS, tree
    writer = McapWriter(tmp_path / "a.mcap")
    for name, (kind, data) in kinds.items():
        writer.write(name, kind, data[:30] if name == topic else data, 0, 0)
    writer.close()
    with pytest.raises(RecordingError, match=rf"a\.mcap: {topic}: a .* message cannot be decoded"):
        open_recording(tmp_path / "a.mcap")


def test_descriptions_of_the_future_are_refused(tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap")
    writer.describe({"armsight.cell": {"version": "99"}}, {})
    writer.close()
    with pytest.raises(RecordingError, match="update armsight"):
        open_recording(tmp_path / "a.mcap")


def test_views_of_other_observers_do_not_disturb(tmp_path: Path) -> None:
    cell = make_cell()
    recorder = Recorder(tmp_path / "a.mcap", cell)
    recorder.update(0.0)  # not attached yet
    session = FakeSession(cell)
    recorder.attach(session)
    session.shown = empty_view(0.0)
    recorder.update(0.0)
    recorder.close()
    recorder.update(1.0)
    recorder.on_reading(make_frame(cell.cameras[0].info, 0, 1.0, np.random.default_rng(0)), 1.0)
    assert recorder.problem == ""


def test_a_recorded_cell_whose_tip_floats_is_built_without_the_sensor_that_feels_it() -> None:
    """Replays of ur10_servoing could not be opened: its [tip] asked for the [wrench] left out."""
    text = packaged()["ur10_servoing"].read_text(encoding="utf-8")
    description = CellDescription("ur10", "pen", np.eye(4), (), (), ())
    again = parse_workcell(_as_recorded(text, description))
    assert again.wrench is None
    assert robot_in(again).tool is not None


def foreign(path: Path, *extra: tuple[str, str, bytes]) -> Path:
    """Depth that starts after many messages of others, as drivers warm up."""
    lens = camera_info("c").depth
    writer = McapWriter(path)

    def write(topic: str, kind: str, data: bytes, at: int) -> None:
        writer.write(topic, kind, data, at * 1_000_000, at * 1_000_000)

    for topic, kind, data in extra:
        write(topic, kind, data, 0)
    for i in range(500):
        data = messages.encode_transforms([("map", "elsewhere", np.eye(4))], 1e-3 * i)
        write("/tf", messages.TRANSFORMS, data, i)
    for name in ("image_raw", "image_rect_raw"):
        depth = messages.encode_depth(np.ones((48, 64), np.float32), 0.6, "lens")
        write(f"/c/depth/{name}", messages.IMAGE, depth, 600)
    write("/c/depth/camera_info", messages.CAMERA_INFO, _info(lens), 600)
    writer.close()
    return path


def _info(lens: PinholeCamera, **fields: object) -> bytes:
    message = messages.decode(messages.encode_camera_info(lens, 0.0, "lens"), messages.CAMERA_INFO)
    return messages.encode(replace(message, **fields))


def test_what_starts_late_and_what_is_none_of_ours_does_not_matter(tmp_path: Path) -> None:
    """It looked at 400 messages, at every lens, and at every transform."""
    lens = camera_info("c").depth
    fisheye = _info(lens, distortion_model="equidistant", d=np.full(4, 0.1))
    upset = messages.decode(
        messages.encode_transforms([("a", "b", np.eye(4))], 0.0), messages.TRANSFORMS
    )
    upset.transforms[0].transform.rotation.w = 0.0
    path = foreign(
        tmp_path / "a.mcap",
        ("/fisheye/camera_info", messages.CAMERA_INFO, fisheye),
        ("/tf_static", messages.TRANSFORMS, messages.encode(upset)),
    )
    with open_recording(path) as cell:
        assert {camera.info.name for camera in cell.cameras} == {
            "c_depth_image_raw",
            "c_depth_image_rect_raw",
        }
        cell.world.advance(1.0)
        assert all(camera.read() is not None for camera in cell.cameras)


@pytest.mark.parametrize(
    ("topic", "encoding", "depth"),
    [
        ("/k/ir/image_raw", "mono16", False),  # a Kinect's: was taken for depth, a wall at its face
        ("/k/sd/image_ir", "16UC1", False),
        ("/k/image_raw", "mono16", False),
        ("/k/depth/image_raw", "mono16", True),
        ("/k/aligned_depth_to_infra1/image_raw", "16UC1", True),
        ("/k/image_raw", "16UC1", True),
    ],
)
def test_infrared_in_16_bits_is_no_depth(
    tmp_path: Path, topic: str, encoding: str, depth: bool
) -> None:
    grey = messages._image(np.full((48, 64), 900, np.uint16), encoding, 0.0, "lens")
    lens = _info(camera_info("c").depth)
    path = foreign(
        tmp_path / "a.mcap",
        (topic, messages.IMAGE, grey),
        (topic.rsplit("/", 1)[0] + "/camera_info", messages.CAMERA_INFO, lens),
    )
    with open_recording(path) as cell:
        assert any(camera.info.name.startswith("k") for camera in cell.cameras) == depth


def test_a_camera_that_was_never_calibrated_is_refused(tmp_path: Path) -> None:
    lens = _info(camera_info("c").depth, k=np.zeros(9))
    path = foreign(tmp_path / "a.mcap", ("/c/depth/camera_info", messages.CAMERA_INFO, lens))
    with pytest.raises(RecordingError, match=r"lens.*no lens; was the camera not calibrated"):
        open_recording(path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("cameras", "[" * 100_000),
        ("static", "[[1]]"),
        ("static", '[{"size": [1, 1, 1], "color": [1, 1, 1], "pose": 1e999}]'),
        ("joint_names", "7"),
        ("T_world_base", "{}"),
    ],
)
def test_a_description_of_any_shape_is_refused_in_words(
    tmp_path: Path, key: str, value: str
) -> None:
    described = to_metadata(CellDescription("ur5", "none", np.eye(4), (), (), ()))
    described["armsight.cell"][key] = value
    writer = McapWriter(tmp_path / "a.mcap")
    writer.describe(described, {})
    writer.close()
    with pytest.raises(RecordingError, match="description of its cell is damaged"):
        open_recording(tmp_path / "a.mcap")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("workcell.toml", b"\xff\xfe"),
        ("workcell.toml", b"[cell\nname = 3"),
        ("workcell.toml", b"robot = 3\n[cell]\nname = 'a'"),
        ("workcell.toml", b"simulation = 3\n[cell]\nname = 'a'"),
        ("workcell.toml", b"[cell]\nname = 'a'"),
        ("calibration.toml", b"\xff\xfe"),
        ("calibration.toml", b"[calibration\n"),
    ],
)
def test_a_cell_file_of_any_shape_is_refused_in_words(
    tmp_path: Path, name: str, text: bytes
) -> None:
    described = to_metadata(CellDescription("ur5", "./own.toml", np.eye(4), (), (), ()))
    writer = McapWriter(tmp_path / "a.mcap")
    whole = {"workcell.toml": b"[cell]\nname = 'a'\n[robot]\nmodel = 'ur5'\n"}
    writer.describe(described, {**whole, name: text})
    writer.close()
    with pytest.raises(RecordingError, match=r"a\.mcap"):
        open_recording(tmp_path / "a.mcap")


def test_what_a_replay_does_not_need_of_the_cells_file_cannot_be_wrong() -> None:
    """A recording outlives the checks of its day: goals that an older armsight took."""
    text = (
        "[cell]\nname = 'a'\n[robot]\nmodel = 'ur5'\n"
        "joint_lower_deg = [40, -180, -180, -180, -180, -180]\n"
        "joint_upper_deg = [50, 180, 180, 180, 180, 180]\n"
        "[patrol]\ngoals_deg = {A = [0, 0, 0, 0, 0, 0], B = [45, 0, 0, 0, 0, 0]}\n"
        "[[simulation.target]]\nname = 't'\nposition = [1000, 0, 0]\n"
    )
    description = CellDescription("ur5", "none", np.eye(4), (), (), ())
    robot = robot_in(parse_workcell(_as_recorded(text, description)))
    assert np.rad2deg(robot.limits.upper[0]) == pytest.approx(50)


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_damaged_messages_are_an_error_in_words_never_a_crash(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Bytes inside of messages, in a file that is whole otherwise."""
    path = tmp_path_factory.getbasetemp() / "all_streams.mcap"
    if not path.exists():
        _all_streams(path)
    with McapReader(path) as reader:
        kept = [(t, k, r.data, r.log_time) for t, k, r in reader.messages()]
        metadata = reader.contents.metadata
    hit = data.draw(st.integers(0, len(kept) - 1))
    spoilt = bytearray(kept[hit][2])
    for _ in range(data.draw(st.integers(1, 8))):
        spoilt[data.draw(st.integers(4, min(len(spoilt), 400) - 1))] = data.draw(
            st.integers(0, 255)
        )
    other = tmp_path_factory.mktemp("spoilt") / "a.mcap"
    writer = McapWriter(other)
    writer.describe(metadata, {})
    for i, (topic, kind, raw, at) in enumerate(kept):
        writer.write(topic, kind, bytes(spoilt) if i == hit else raw, at, at)
    writer.close()
    try:
        with open_recording(other) as cell:
            cell.world.advance(100.0)
    except RecordingError:
        pass


def _all_streams(path: Path) -> None:
    rng = np.random.default_rng(0)
    cell = make_cell()
    recorder = Recorder(path, cell, pictures="small")
    session = FakeSession(cell)
    recorder.attach(session)
    recorder.on_reading(make_joints(0.1, 6, rng), 0.1)
    recorder.on_reading(make_frame(cell.cameras[0].info, 0, 0.1, rng), 0.1)
    recorder.on_reading(ArmStatus(0.1, "running", 0.5, "fine"), 0.1)
    recorder.on_reading(Wrench(0.1, np.ones(3), np.ones(3)), 0.1)
    recorder.on_reading(GripperState(0.1, 0.05, False), 0.1)
    recorder.on_reading(DeclaredSolids(0.1, "car", cell.static), 0.1)
    session.shown = empty_view(0.2, guard=make_status(0.2, 6, rng), movers=make_movers(rng))
    recorder.update(0.2)
    recorder.close()

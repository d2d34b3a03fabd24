"""Compressed pictures: as near to the whole ones as they say, readable without us, far smaller."""

import io
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from PIL import Image
from recorded_cells import FakeSession, make_cell

from armsight.devices.data import JointState, RgbdFrame, StereoFrame
from armsight.errors import RecordingError
from armsight.recording import messages, small_pictures
from armsight.recording.mcap_file import McapReader
from armsight.recording.recorder import Recorder
from armsight.recording.replay import open_recording


def smooth(height, width):
    """(h, w, 3) uint8 without edges, as JPEG likes it."""
    y, x = np.mgrid[0:height, 0:width] / 24.0
    return np.stack([120 + 60 * np.sin(x + k) * np.cos(y) for k in range(3)], -1).astype(np.uint8)


def test_depth_comes_back_to_half_a_step_which_grows_with_its_square():
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.3, 8.0, (48, 64)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = np.nan
    depth[0, :4] = (25.0, 0.0, -1.0, np.inf)
    data = small_pictures.encode_depth(depth, 12.25, "cam")
    message = messages.decode(data, messages.COMPRESSED)
    back = small_pictures.decode_depth(message)
    assert messages.stamp_of(message) == 12.25
    assert np.isnan(back[0, :4]).all(), "too far, and what is no depth, is no return"
    seen = np.isfinite(back)
    assert (seen == np.isfinite(depth))[1:].all()
    step = depth[seen] ** 2 / small_pictures.STEPS
    assert (np.abs(back[seen] - depth[seen]) <= 0.51 * step + 1e-6).all()
    # As ROS's compressed_depth_image_transport decodes it, by its own formula and another library.
    A, B = np.frombuffer(message.data[4:12].tobytes(), "<f4")
    stored = np.array(Image.open(io.BytesIO(message.data[12:].tobytes())), float)
    assert A / (stored[seen] - B) == pytest.approx(back[seen], rel=1e-5)


def test_colour_is_a_jpeg():
    picture = smooth(40, 60)
    message = messages.decode(small_pictures.encode_color(picture, 1.0, "cam"), messages.COMPRESSED)
    other = np.array(Image.open(io.BytesIO(message.data.tobytes())))
    back = small_pictures.decode_color(message)
    assert np.abs(back.astype(int) - picture).mean() < 3.0
    assert np.abs(back.astype(int) - other).max() <= 4


def test_what_is_no_picture_is_said_to_be_none():
    header = SimpleNamespace(frame_id="cam")
    png = cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1].tobytes()
    for data, kind in (
        (b"no picture", "jpeg"),
        (b"short", small_pictures.DEPTH),
        (b"\0" * 12 + png, small_pictures.DEPTH),
        (b"\0" * 40, "16UC1; compressedDepth rvl"),
    ):
        message = SimpleNamespace(header=header, data=np.frombuffer(data, np.uint8), format=kind)
        decode = small_pictures.decode_color if kind == "jpeg" else small_pictures.decode_depth
        with pytest.raises(RecordingError, match="compressed picture of cam"):
            decode(message)


def test_a_small_recording_replays_and_says_how_often_it_has_pictures(tmp_path):
    cell = make_cell()
    info, other = (camera.info for camera in cell.cameras)
    rng = np.random.default_rng(1)
    sizes = {}
    for pictures in ("whole", "small"):
        recorder = Recorder(tmp_path / f"{pictures}.mcap", cell, pictures=pictures)
        recorder.attach(FakeSession(cell))
        recorder.on_reading(JointState(0.0, np.zeros(6), np.zeros(6)), 0.0)
        for k in range(45):  # 15 Hz, every third with colour
            for one in (info, other):
                depth = 2.0 + rng.normal(0, 0.01, (one.depth.height, one.depth.width))
                color = smooth(24, 32) if one is info and k % 3 == 0 else None
                frame = RgbdFrame(one.name, k, k / 15, k / 15, depth.astype(np.float32), color)
                recorder.on_reading(frame, k / 15 + 0.03)
        sizes[pictures] = recorder.close().stat().st_size
    assert sizes["small"] < 0.15 * sizes["whole"]
    reader = McapReader(tmp_path / "small.mcap")
    assert reader.topics["/left/depth/image_raw/compressedDepth"] == messages.COMPRESSED
    assert reader.topics["/left/color/image_raw/compressed"] == messages.COMPRESSED
    reader.close()
    with open_recording(tmp_path / "small.mcap") as cell:
        left, right = cell.cameras
        assert left.info.rate == right.info.rate == pytest.approx(2.0)
        cell.world.advance(1.1)
        got = left.read()
        assert got.color.shape == (24, 32, 3), "those with colour are kept"
        assert np.nanmedian(got.depth) == pytest.approx(2.0, abs=0.005)
        assert right.read().color is None


def test_pictures_are_kept_evenly_and_all_other_readings_are():
    thinning = small_pictures.Thinning()
    pair = [StereoFrame("w", k, 0.1 * k, 0.1 * k, smooth(4, 4), smooth(4, 4)) for k in range(30)]
    kept = [frame.stamp for frame in pair if thinning.keeps(frame)]
    assert np.diff(kept) == pytest.approx(0.5)
    assert all(thinning.keeps(JointState(0.01 * k, np.zeros(6), np.zeros(6))) for k in range(9))

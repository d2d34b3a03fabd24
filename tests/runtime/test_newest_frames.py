"""What a subscriber finds who looks seldom: the newest frames, and no colour lost."""

import numpy as np

from armsight.devices.data import RgbdFrame
from armsight.motion.perception import CameraUse
from armsight.runtime.posing import NewestFrames

DEPTH = np.ones((2, 3), np.float32)
COLOR = np.zeros((2, 3, 3), np.uint8)


def frame(stamp, color=None, camera="front"):
    return RgbdFrame(camera, round(100 * stamp), stamp, stamp, DEPTH, color)


def stamps(frames):
    return [f.stamp for f in frames]


def test_a_colour_picture_waits_for_who_is_behind_and_wants_it():
    for name in ("front", ""):
        box = NewestFrames([CameraUse(name, color_rate=5.0)])
        box.put(frame(0.1, COLOR))
        box.put(frame(0.2))
        assert stamps(box.take()) == [0.1]
        box.put(frame(0.3))
        assert stamps(box.take()) == [0.3], "the picture has been looked at"
        box.put(frame(0.4))
        box.put(frame(0.5, COLOR))
        box.put(frame(0.6, COLOR))
        assert stamps(box.take()) == [0.6]


def test_a_task_that_looks_in_every_round_finds_each_picture_once_and_goes_on():
    box = NewestFrames([CameraUse("front", color_rate=5.0)])
    box.put(frame(0.1, COLOR))
    box.put(frame(0.2))
    assert stamps(box.newest()) == [0.1]
    assert stamps(box.newest()) == [0.1]
    box.put(frame(0.3))
    assert stamps(box.newest()) == [0.3]


def test_who_wants_no_colour_gets_the_newest_frame():
    box = NewestFrames([CameraUse("front"), CameraUse("side", color_rate=5.0)])
    box.put(frame(0.1, COLOR))
    box.put(frame(0.2))
    assert stamps(box.take()) == [0.2]
    box.use([CameraUse("front", color_rate=5.0)])
    box.put(frame(0.3, COLOR))
    box.put(frame(0.4))
    assert stamps(box.take()) == [0.3]

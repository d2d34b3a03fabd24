"""A socket with a pin that is bent, or lies broken in it: the law says that it does not go in."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.charging.insert import InsertOptions
from armsight.charging.ports.table import PORTS
from armsight.experiments import insertion_bench
from armsight.geometry.pose import make_pose

PLUG, INLET = PORTS["type2_plug"], PORTS["type2"]
AROUND = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)


def with_tubes(contours):
    """A plug whose contact tubes touch as well, 8 mm behind its rim."""
    ends = [
        [x, y, -9.5e-3, x, y, -PLUG.depth + 1.5e-3]
        for pin in PLUG.pins
        for x, y in zip(pin.x + 3.5e-3 * np.cos(AROUND), pin.y + 3.5e-3 * np.sin(AROUND))
    ]
    return replace(contours, capsules=np.vstack([contours.capsules, ends]))


def with_box(contours, middle, half):
    boxes = np.concatenate([contours.boxes, make_pose(None, middle)[None]])
    return replace(contours, boxes=boxes, half=np.vstack([contours.half, half]))


def bent(contours):
    """L1 stands 3.5 mm beside its place, its tip where it was."""
    pin, deep = next(p for p in INLET.pins if p.name == "L1"), PLUG.depth + 8e-3
    middle = [pin.x - 3.5e-3, pin.y, 0.5 * (pin.z - deep)]
    return with_box(contours, middle, [2.5e-3, 2.5e-3, 0.5 * (deep + pin.z)])


def broken(contours):
    """A piece of 3 mm lies on the floor of the groove that the sleeve enters."""
    middle = [PLUG.plate.radius - 1.5e-3, 0.0, -PLUG.depth + 1.5e-3]
    return with_box(contours, middle, [3e-3, 3e-3, 1.5e-3])


@pytest.mark.parametrize(("pin", "depth"), [(bent, 17.5), (broken, 33.0)])
def test_a_plug_that_a_pin_keeps_out_is_jammed_and_not_seated(monkeypatch, pin, depth):
    walls, sleeve = insertion_bench.socket_contours, insertion_bench.plug_contours
    monkeypatch.setattr(insertion_bench, "socket_contours", lambda *given: pin(walls(*given)))
    monkeypatch.setattr(insertion_bench, "plug_contours", lambda p: with_tubes(sleeve(p)))
    trial = replace(insertion_bench.draw(np.random.default_rng(5), 2e-3, 1.0), port="type2")
    once = InsertOptions(tries=1)
    result = insertion_bench.run_trial(trial, unplug=False, options=once)
    assert not result["said"]
    assert "jammed at" in result["words"]
    assert float(result["words"].split()[2]) == pytest.approx(depth, abs=1.0)
    assert result["axial_n"] < 110.0

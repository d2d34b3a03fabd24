"""Every mistake that people make with a recorded set is named, and nothing else is."""

import numpy as np
import pytest
from arms import ur5

from armsight.calibration.layouts.two_recordings import two_findings
from armsight.experiments.calibration_mistakes import (
    MISTAKES,
    clean_set,
    findings_of,
    judge,
    write_mistake,
)
from armsight.experiments.calibration_stranger_runs import clean_run


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_and_no_other(name, tmp_path):
    rng = np.random.default_rng([77, list(MISTAKES).index(name)])
    folder = write_mistake(tmp_path, name, clean_set(ur5(), rng), rng)
    named, wrong = judge(name, findings_of(tmp_path, folder))
    assert named
    assert wrong == set()


@pytest.mark.parametrize("seed", range(2))
def test_a_clean_set_is_not_blamed(seed, tmp_path):
    rng = np.random.default_rng([78, seed])
    folder = write_mistake(tmp_path, "", clean_set(ur5(), rng, 3e-3), rng)
    told = findings_of(tmp_path, folder)
    assert [code for code, severity in told if severity == "error" or code == "slip"] == []


@pytest.mark.parametrize("number", [9, 36])
def test_views_of_an_arm_that_errs_by_two_millimetres_stay(number):
    """Views went one by one, each making the rest look better, until half of the set was gone."""
    run = clean_run(11, number, ur5())
    assert run["size"] > 1.9e-3
    assert [code for code, severity in run["told"] if severity == "error"] == []
    assert "outlier" not in [code for code, _ in run["told"]]


def test_two_parts_have_their_names():
    names = [f"{k}.png" for k in range(6)]
    late = two_findings(np.array([True, True, True, False, False, False]), names)
    assert (late[0].code, "2.png and 3.png" in late[0].message) == ("slip", True)
    mixed = two_findings(np.array([True, False, True, False, True, True]), names)
    assert mixed[0].code == "two_cameras"

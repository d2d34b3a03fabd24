"""Sets that others recorded and published, as they lie in ../shared/data; skipped without them."""

from pathlib import Path

import pytest

from armsight.calibration.recorded_set import load


@pytest.mark.parametrize(("name", "views"), [("ros_industrial_charuco", 15)])
def test_a_set_of_others_has_its_poses(shared_data: Path, name: str, views: int) -> None:
    """Its poses were refused for a week, since files with names keep no order of them."""
    folder = shared_data / "calibration" / name
    if not folder.is_dir():
        pytest.skip(f"no calibration/{name} in ../shared/data")
    found = load(folder)
    assert found.poses is not None
    assert len(found.poses) >= views
    assert [f.code for f in found.findings if f.severity == "error"] == []

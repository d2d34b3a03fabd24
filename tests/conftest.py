"""What tests of every room share."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def gl() -> str:
    """Name of the OpenGL renderer; skips the test where there is none."""
    from armsight.errors import ArmsightError
    from armsight.simulation.gl import check_opengl

    try:
        return check_opengl()
    except ArmsightError as error:
        pytest.skip(f"no OpenGL: {error}")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded data beside the repository; skips the test where there is none."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no ../shared/data beside the repository")
    return folder

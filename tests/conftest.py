"""What tests of every room share."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# The same run twice is the same run; ``--hypothesis-profile search`` looks for new examples.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None)
settings.load_profile("same")

# As the command line has it (cli.py), before anything loads numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_opengl = {"name": "", "problem": "not looked for"}


def pytest_sessionstart() -> None:
    """Look for OpenGL before anything else is loaded.

    Its libraries want thread-local storage that is fixed when they load, and too many other
    libraries before them leave none: contexts are made then, but do nothing.
    """
    from armsight.errors import ArmsightError
    from armsight.simulation.gl import check_opengl

    try:
        _opengl.update(name=check_opengl(), problem="")
    except ArmsightError as error:
        _opengl["problem"] = str(error)


@pytest.fixture(scope="session")
def gl() -> str:
    """Name of the OpenGL renderer; skips the test where there is none."""
    if _opengl["problem"]:
        pytest.skip(f"no OpenGL: {_opengl['problem']}")
    return _opengl["name"]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded data beside the repository; skips the test where there is none."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no ../shared/data beside the repository")
    return folder

from pathlib import Path

import numpy as np
import pytest
from arms import ur5


@pytest.fixture(scope="session")
def arm5():
    return ur5()


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.fixture(scope="session")
def calibration_data() -> Path:
    folder = Path(__file__).resolve().parents[3] / "shared" / "data" / "calibration"
    if not folder.is_dir():
        pytest.skip("shared/data/calibration is not beside this checkout")
    return folder

import pytest


@pytest.fixture(autouse=True)
def own_runtime_directory(tmp_path, monkeypatch):
    monkeypatch.setenv("ARMSIGHT_RUNTIME_DIR", str(tmp_path / "locks"))

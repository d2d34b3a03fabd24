"""Compiled kernels have a place for everybody, and nobody else's are taken."""

import os
import stat

import pytest

from armsight.kernel_cache import KEY, find_place


@pytest.fixture
def read_only(monkeypatch, tmp_path):
    """A package and a home that cannot be written, whoever runs this."""
    package, home = tmp_path / "package", tmp_path / "home"
    package.mkdir()
    home.write_text("no folder")
    access = os.access
    monkeypatch.setattr(os, "access", lambda f, how: f != package and access(f, how))
    return package, {"XDG_CACHE_HOME": str(home)}


def place(read_only, tmp_path):
    package, environment = read_only
    find_place(environment, package, tmp_path)
    return environment.get(KEY)


def test_a_service_without_a_home_has_a_place_of_its_own(read_only, tmp_path):
    found = place(read_only, tmp_path)
    assert os.path.dirname(found) == str(tmp_path)
    assert stat.S_IMODE(os.stat(found).st_mode) == 0o700
    assert place(read_only, tmp_path) == found  # kept from start to start


@pytest.mark.parametrize("how", ["writable", "link"])
def test_what_others_could_have_filled_is_not_taken(read_only, tmp_path, how):
    theirs = tmp_path / f"armsight-kernels-{os.getuid()}"
    if how == "link":
        (tmp_path / "elsewhere").mkdir()
        theirs.symlink_to(tmp_path / "elsewhere")
    else:
        theirs.mkdir()
        theirs.chmod(0o777)
    found = place(read_only, tmp_path)
    assert found != str(theirs)
    assert stat.S_IMODE(os.stat(found).st_mode) == 0o700


@pytest.mark.parametrize("what", ["package", "home", "told"])
def test_nothing_is_changed_where_there_is_a_place(read_only, tmp_path, what):
    package, environment = read_only
    if what == "package":
        package = tmp_path
    elif what == "home":
        environment["XDG_CACHE_HOME"] = str(tmp_path / "cache")
    else:
        environment[KEY] = "mine"
    find_place(environment, package, tmp_path)
    assert environment.get(KEY) == ("mine" if what == "told" else None)

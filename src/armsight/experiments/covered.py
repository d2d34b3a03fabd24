"""Which tests run which lines of some modules, and for how long: a pytest plugin.

``python -m pytest -p armsight.experiments.covered`` with ``ARMSIGHT_COVERED=FILE=MODULE,MODULE``
writes FILE (JSON), which :func:`read` reads. Lines that run while a module is imported belong to
every test; those of a fixture, which others may share, to every test of the file that first asked
for it. Compiled functions run no lines: nothing is known of them.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

VARIABLE = "ARMSIGHT_COVERED"
EVERY = ""
"""The test to which lines belong that run while modules are imported."""
Line = tuple[str, int]
"""A module's name, and a line of it from 1."""


@dataclass
class Covered:
    """What ran.

    Attributes:
        lines: of each test, by its node id; of :data:`EVERY` those that ran before all.
        seconds: processor time of each test, its fixtures included [s].
    """

    lines: dict[str, set[Line]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def tests(self, module: str, first: int, last: int) -> list[str]:
        """The tests that run one of these lines of a module, quickest first.

        Where they run on import all tests do, after those that run them once more.
        """
        wanted = {(module, line) for line in range(first, last + 1)}
        order = sorted(self.seconds, key=self.seconds.__getitem__)
        ran = [test for test in order if self.lines.get(test, set()) & wanted]
        if self.lines.get(EVERY, set()) & wanted:
            ran += [test for test in order if test not in set(ran)]
        return ran


def read(file: Path) -> Covered:
    """What a run with this plugin has written."""
    told = json.loads(file.read_text("utf-8"))
    lines = {test: {(m, int(n)) for m, n in ran} for test, ran in told["lines"].items()}
    return Covered(lines, told["seconds"])


def together(several: Iterable[Covered]) -> Covered:
    """What ran in several runs, of other tests each."""
    whole = Covered()
    for covered in several:
        whole.seconds.update(covered.seconds)
        for test, lines in covered.lines.items():
            whole.lines.setdefault(test, set()).update(lines)
    return whole


class _Watch:
    """Listens to the interpreter."""

    def __init__(self, file: Path, modules: list[str]) -> None:
        self._file = file
        self._names = {_origin(module): module for module in modules}
        self._found = Covered()
        self._now: set[Line] = set()
        sys.settrace(self._call)
        threading.settrace(self._call)

    def _call(self, frame: FrameType, event: str, arg: Any) -> Any:
        return self._line if frame.f_code.co_filename in self._names else None

    def _line(self, frame: FrameType, event: str, arg: Any) -> Any:
        if event == "line":
            self._now.add((self._names[frame.f_code.co_filename], frame.f_lineno))
        return self._line

    def _take(self, test: str) -> None:
        self._found.lines.setdefault(test, set()).update(self._now)
        self._now.clear()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        if not self._found.seconds:
            self._take(EVERY)
        begin = time.process_time()
        done = yield
        self._take(item.nodeid)
        self._found.seconds[item.nodeid] = time.process_time() - begin
        return done

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        done = yield
        self._take(_of_file(item.nodeid))
        return done

    def pytest_sessionfinish(self, exitstatus: int) -> None:
        sys.settrace(None)
        threading.settrace(None)
        if exitstatus:
            return
        lines = self._found.lines
        for test in self._found.seconds:
            lines[test] |= lines.get(_of_file(test), set())
        told = {test: sorted(ran) for test, ran in lines.items()}
        self._file.write_text(json.dumps({"lines": told, "seconds": self._found.seconds}), "utf-8")


def _of_file(test: str) -> str:
    return test.partition("::")[0]


def _origin(module: str) -> str:
    spec = importlib.util.find_spec(module)
    assert spec is not None, module
    assert spec.origin is not None, module
    return spec.origin


def pytest_configure(config: pytest.Config) -> None:
    """Called by pytest."""
    file, _, modules = os.environ.get(VARIABLE, "").partition("=")
    if file:
        config.pluginmanager.register(_Watch(Path(file), modules.split(",")))

"""``armsight doctor``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

from armsight.commands.serving import Page

Verdict = Literal["good", "slow", "missing", "info"]


@dataclass(frozen=True)
class MachineFinding:
    """One thing looked at.

    Attributes:
        verdict: ``good``; ``slow``: works, but badly; ``missing``: something will not work;
            ``info``: neither.
        title: what was looked at.
        found: what was found.
        mend: what to do, or empty.
    """

    verdict: Verdict
    title: str
    found: str
    mend: str = ""


@dataclass(frozen=True)
class Doctor:
    """Say what of this machine is missing or slow, or what is wrong with a driver.

    Example: armsight doctor --driver my_camera:Camera --kind camera --option serial=123

    Attributes:
        port: that the live page would use.
        driver: run this driver (its name, or module:Class) against what armsight asks of one.
        kind: of the driver; found out where its name is installed for one kind only.
        option: what the driver is to connect to, as in the cell file's `connection`: KEY=VALUE.
        robot: whose joints the arm has.
        seconds: how long the driver is read.
        move: also move an arm or a gripper a little. Without this no command is sent.
    """

    port: int = Page().port
    driver: str | None = None
    kind: Literal["arm", "camera", "stereo", "wrench", "gripper", "switch"] | None = None
    option: tuple[str, ...] = ()
    robot: str = "ur5"
    seconds: float = 3.0
    move: bool = False

    def run(self) -> int:
        """Print the findings; 1 if something is missing or wrong."""
        from rich.console import Console

        if self.driver is not None:
            from armsight.commands.driver_check import check_driver

            return check_driver(
                self.driver, self.kind, self.option, self.robot, self.seconds, self.move
            )

        marks = {
            "good": "[green]good   [/]",
            "slow": "[yellow]slow   [/]",
            "missing": "[red]missing[/]",
            "info": "[dim]       [/]",
        }
        out, missing = Console(soft_wrap=True, highlight=False), 0
        for finding in findings(self.port):
            out.print(f"{marks[finding.verdict]} {finding.title:16} ", end="")
            out.print(finding.found, markup=False)
            if finding.mend:
                out.print(f"{'':24} -> {finding.mend}", markup=False)
            missing += finding.verdict == "missing"
        return 1 if missing else 0


def findings(port: int) -> Iterator[MachineFinding]:
    """Everything that is looked at; a check that breaks is itself a finding."""
    checks: tuple[tuple[str, Callable[[], MachineFinding]], ...] = (
        ("armsight", _version),
        ("Python", _python),
        ("cores", _cores),
        ("priority", _priority),
        ("memory", _memory),
        ("disk", _disk),
        ("packages", _packages),
        ("OpenGL", _opengl),
        ("rendering", _rendering),
        ("kernels", _kernels),
        ("cells", _cells),
        ("port", lambda: _port(port)),
        ("browser", _browser),
    )
    for title, check in checks:
        try:
            yield check()
        except Exception as error:  # the doctor must not fall ill
            first = (str(error).splitlines() or [""])[0]
            yield MachineFinding("missing", title, f"{type(error).__name__}: {first}")


def _version() -> MachineFinding:
    from armsight import __version__
    from armsight.machine import commit

    return MachineFinding("info", "armsight", f"{__version__}, commit {commit()}")


def _python() -> MachineFinding:
    import platform
    import sys

    found = f"{platform.python_version()} at {sys.prefix}"
    if sys.version_info >= (3, 14):
        return MachineFinding(
            "slow", "Python", found, "tested with 3.11 to 3.13; prefer one of these"
        )
    return MachineFinding("good", "Python", found)


def _cores() -> MachineFinding:
    import os

    from armsight.machine import processor, usable_cores

    cores, load = usable_cores(), os.getloadavg()[0]
    found = f"{cores} of {processor()}, load {load:.1f}"
    if cores < 2:
        return MachineFinding(
            "slow", "cores", found, "mapping and planning want 2 cores beside the page"
        )
    if load > cores:
        return MachineFinding(
            "slow", "cores", found, "other programs keep this machine busy; end them"
        )
    return MachineFinding("good", "cores", found)


def _priority() -> MachineFinding:
    from armsight.runtime.priority import offered

    found, real_time, share = offered()
    if real_time and share:
        return MachineFinding("good", "priority", found)
    return MachineFinding(
        "info",
        "priority",
        found,
        "for a real arm on a machine that has other work: as root, put '@YOUR_GROUP - rtprio 50' "
        "and '@YOUR_GROUP - nice -10' into /etc/security/limits.d/armsight.conf; log in anew",
    )


def _memory() -> MachineFinding:
    from armsight.machine import memory_gib

    size = memory_gib()
    if size < 3.5:
        return MachineFinding(
            "slow", "memory", f"{size:.1f} GiB", "4 GiB or more; use a coarser voxel"
        )
    return MachineFinding("good", "memory", f"{size:.1f} GiB")


def _disk() -> MachineFinding:
    import shutil
    from pathlib import Path

    free = shutil.disk_usage(Path.cwd()).free / 2**30
    found = f"{free:.1f} GiB free in {Path.cwd()}"
    if free < 2:
        return MachineFinding(
            "slow",
            "disk",
            found,
            "a recording takes 0.1 GB a minute, with whole pictures of four cameras 2.5",
        )
    return MachineFinding("good", "disk", found)


def _packages() -> MachineFinding:
    from importlib.metadata import PackageNotFoundError, version

    names = ("numpy", "numba", "mujoco", "viser", "opencv-python-headless", "mcap")
    found, lost = [], []
    for name in names:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            lost.append(name)
    if lost:
        return MachineFinding(
            "missing", "packages", f"not installed: {', '.join(lost)}", "remove .venv, run ./run"
        )
    return MachineFinding("good", "packages", ", ".join(found))


def _opengl() -> MachineFinding:
    from armsight.errors import ArmsightError
    from armsight.simulation.gl import OPENGL_HELP, check_opengl

    try:
        renderer = check_opengl()
    except ArmsightError as error:
        return MachineFinding("missing", "OpenGL", str(error).partition(":")[0], OPENGL_HELP)
    return MachineFinding("good", "OpenGL", renderer)


def _rendering() -> MachineFinding:
    import time

    from armsight.errors import ArmsightError
    from armsight.workcell import load_workcell, open_cell
    from armsight.workcell.packaged import DEFAULT, packaged

    try:
        with open_cell(load_workcell(packaged()[DEFAULT])) as cell:
            assert cell.world is not None
            cell.world.advance(0.15)  # every camera once
            start = time.perf_counter()
            cell.world.advance(1.15)
            factor = 1.0 / (time.perf_counter() - start)
    except ArmsightError as error:
        return MachineFinding("missing", "rendering", str(error))
    found = f"four Kinect v2 at 15 Hz: {factor:.1f} simulated seconds a second, world alone"
    if factor < 1.5:
        return MachineFinding(
            "slow", "rendering", found, "the page will run slower than life; use fewer cameras"
        )
    return MachineFinding("good", "rendering", found)


def _kernels() -> MachineFinding:
    import os
    from pathlib import Path

    import armsight

    package = Path(armsight.__file__).parent
    compiled = sum(1 for _ in package.rglob("__pycache__/*.nbc"))
    folder = os.environ.get("NUMBA_CACHE_DIR", "")
    if not folder and not os.access(package, os.W_OK):
        return MachineFinding(
            "info",
            "kernels",
            f"{compiled} compiled; {package} is read-only, new ones go to the user's cache",
        )
    if compiled == 0 and not folder:
        return MachineFinding("info", "kernels", "none compiled yet: the first start takes longer")
    return MachineFinding("good", "kernels", f"{compiled} compiled and kept")


def _cells() -> MachineFinding:
    from armsight.workcell import load_workcell
    from armsight.workcell.packaged import packaged

    names = [load_workcell(file).name for file in packaged().values()]
    return MachineFinding(
        "good" if names else "missing", "cells", ", ".join(names) or "none packaged"
    )


def _port(port: int) -> MachineFinding:
    import socket

    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return MachineFinding(
                "slow",
                "port",
                f"{port} is in use",
                "choose another with --port; --port 0 takes a free one",
            )
    return MachineFinding("good", "port", f"{port} is free")


def _browser() -> MachineFinding:
    import shutil

    for name in ("chromium", "chromium-browser", "google-chrome"):
        found = shutil.which(name)
        if found:
            return MachineFinding("info", "browser", f"{found} (for the tests of the page)")
    return MachineFinding("info", "browser", "no Chromium here: the tests of the page are skipped")

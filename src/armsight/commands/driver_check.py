"""``armsight doctor --driver``: runs a driver against the conformance kit."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any, cast

from rich.console import Console

from armsight.devices.conformance import conformance
from armsight.devices.port import (
    GROUPS,
    ArmSettings,
    CameraSettings,
    Connection,
    GripperSettings,
    Kind,
    SwitchSettings,
    WrenchSettings,
)
from armsight.errors import UsageError
from armsight.runtime.lock import arm_address, arm_lock
from armsight.workcell.drivers import driver_names, find_driver


def check_driver(
    name: str,
    kind: str | None,
    options: Sequence[str],
    robot: str,
    seconds: float,
    move: bool,
) -> int:
    """Print what the kit finds; 1 if something is not as it has to be.

    Raises:
        UsageError: the kind of the driver or an option cannot be understood.
        DeviceError: there is no such driver, or it cannot be loaded.
        CellBusyError: an arm that was to be moved is another process's.
    """
    what = _kind_of(name, kind)
    opener = find_driver(what, name)
    settings = _settings(what, connection_of(options), robot)
    out, bad = Console(soft_wrap=True, highlight=False), 0
    out.print(f"{what} driver {name}", markup=False)
    with ExitStack() as stack:
        if what == "arm" and move:
            address = arm_address(opener, settings.connection)
            stack.enter_context(arm_lock(address, "armsight doctor"))
        for check in conformance(what, opener, settings, seconds=seconds, commands=move):
            out.print("[green]good[/] " if check.good else "[red]wrong[/]", end=" ")
            out.print(f"{check.title:12} {check.found}", markup=False)
            bad += not check.good
    if what in ("arm", "gripper") and not move:
        out.print("[dim]     [/] commands were not tried; --move tries them", markup=True)
    return 1 if bad else 0


def connection_of(options: Sequence[str]) -> Connection:
    """``KEY=VALUE`` words as a connection table: numbers and true/false are taken as such.

    Raises:
        UsageError: a word without ``=``.
    """
    table: dict[str, str | int | float | bool] = {}
    for option in options:
        key, equals, text = option.partition("=")
        if not equals or not key:
            raise UsageError(f'--option {option}: expected KEY=VALUE, such as "host=198.51.100.7"')
        table[key] = _value(text)
    return table


def _value(text: str) -> str | int | float | bool:
    if text in ("true", "false"):
        return text == "true"
    for number in (int, float):
        try:
            return number(text)
        except ValueError:
            continue
    return text


def _kind_of(name: str, kind: str | None) -> Kind:
    if kind is not None:
        return cast(Kind, kind)
    found = [k for k in GROUPS if name in driver_names(k)[1:]]
    if len(found) != 1:
        kinds = ", ".join(found or GROUPS)
        raise UsageError(f"--driver {name}: say of which --kind it is: {kinds}")
    return found[0]


def _settings(kind: Kind, connection: Connection, robot: str) -> Any:
    if kind == "arm":
        from armsight.robots import load_robot

        arm = load_robot(robot)
        return ArmSettings(
            arm.name,
            connection,
            arm.joint_names,
            0.1 * arm.limits.velocity,
            0.5 * arm.limits.acceleration,
            500.0,
            0.1,
        )
    if kind == "wrench":
        return WrenchSettings(connection, 100.0)
    if kind == "gripper":
        return GripperSettings(connection, 0.085, 0.05, 20.0)
    if kind == "switch":
        return SwitchSettings(connection, 20.0)
    return CameraSettings("doctor", connection)

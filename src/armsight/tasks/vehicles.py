"""Who speaks for a parked car: found by the entry points ``armsight.vehicles``, or by name.

A package says, in its ``pyproject.toml``::

    [project.entry-points."armsight.vehicles"]
    my_car = "my_package:Car"

and the cell file ``car = "my_car"`` in its ``[plug]``; ``car = "my_module:Car"`` needs no package.
The class is called with the table ``[plug.connection]`` and is a
:class:`~armsight.charging.vehicle.Vehicle`.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from armsight.charging.vehicle import Vehicle
from armsight.devices.port import Connection
from armsight.errors import TaskError
from armsight.tasks.catalogue import imported, plugged_in

GROUP = "armsight.vehicles"


def open_vehicle(name: str, connection: Connection) -> Vehicle:
    """Who speaks for the car.

    Args:
        name: ``module:Class``, or that of an entry point.
        connection: what it is called with.

    Raises:
        TaskError: there is none, or it cannot be loaded or opened.
    """
    what = f'vehicle "{name}"'
    found = imported(name, what) if ":" in name else plugged_in(GROUP, name, what)
    if found is None:
        known = ", ".join(sorted({entry.name for entry in entry_points(group=GROUP)})) or "none"
        raise TaskError(
            f"there is no {what}; installed are {known} (they plug in by the entry points "
            f"{GROUP}, or as module:Class)"
        )
    try:
        vehicle: Any = found(connection)
    except Exception as error:  # somebody else's package may fail in any way
        raise TaskError(f"{what} cannot be opened: {type(error).__name__}: {error}") from error
    missing = [word for word in ("status", "tell") if not callable(getattr(vehicle, word, None))]
    if missing:
        raise TaskError(f"{what} has no {missing[0]}(); see armsight.charging.vehicle.Vehicle")
    speaks: Vehicle = vehicle
    return speaks

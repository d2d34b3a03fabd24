"""A charging station before a parked car: which port it finds, how sure, and what it does next.

python examples/13_charge.py [SECONDS]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from armsight import Session, load_workcell, open_cell, packaged
from armsight.tasks.charge import ChargeOptions


def main(seconds: float) -> None:
    with (
        tempfile.TemporaryDirectory() as folder,
        open_cell(load_workcell(packaged()["ur10_charging"]), seed=1) as cell,
    ):
        task = ChargeOptions(state=Path(folder) / "station.json").make(cell)
        session = Session(cell, task, seed=1)
        session.warm_up()
        session.run(seconds)
        station = task.station
    port = station.port
    if port is None:
        print("no port found yet")
        return
    sigma = 1e3 * np.sqrt(np.diag(port.covariance)[:3].max())
    place = np.round(port.T_base_port[:3, 3], 3)
    print(f"{port.port} ({100 * port.score:.0f} %) at {place} m, to {sigma:.1f} mm")
    print(f"now: {station.state.value} {station.words}")
    for outcome in station.outcomes:
        print(f"a visit: seated {outcome.seated}, out {outcome.out} {outcome.problem}")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)

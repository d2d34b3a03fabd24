"""Nothing is compiled while the arm moves: in the first run on a machine that held it up."""

import subprocess
import sys
from textwrap import dedent

import pytest

COUNT = """
    import sys
    from armsight.runtime.config import SessionMode
    from armsight.runtime.session import Session
    from armsight.tasks.servo import ServoOptions
    from armsight.workcell import open_cell
    from armsight.workcell.packaged import load
    from numba.core.registry import CPUDispatcher

    def compiled():
        return {
            f"{value.__module__}.{name}": len(value.signatures)
            for module in list(sys.modules.values())
            for name, value in vars(module).items()
            if isinstance(value, CPUDispatcher) and value.__module__.startswith(
                ("armsight.motion.", "armsight.mapping.", "armsight.servoing.", "armsight.robots.")
            )
        }

    if __name__ == "__main__":
        with open_cell(load("ur10_servoing"), 11) as cell:
            task = ServoOptions().make(cell)
            session = Session(cell, task, seed=11, mode=SessionMode(cell_is_empty=True))
            session.warm_up()
            before = compiled()
            session.run(6.0)
            permit = session.view().guard.permit
            assert permit is not None and permit.holds, permit
            later = [name for name, count in compiled().items() if count > before.get(name, 0)]
            print("later:", *sorted(later))
"""


@pytest.mark.slow
def test_what_the_loop_needs_to_touch_a_ball_is_compiled_before_it_begins():
    done = subprocess.run(
        [sys.executable, "-c", dedent(COUNT)],
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    said = [line for line in done.stdout.splitlines() if line.startswith("later:")]
    assert said == ["later:"]

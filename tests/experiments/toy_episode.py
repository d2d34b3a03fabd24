"""An episode that costs nothing, in a module that costs nothing: worker processes import it."""

import os
import time
from pathlib import Path


def waits(seed: int, run: int) -> dict[str, int]:
    """Says who it is, and goes on for a minute."""
    Path(os.environ["ARMSIGHT_CACHE"], "worker").write_text(str(os.getpid()), "utf-8")
    time.sleep(60.0)
    return {}


def doubled(seed: int, run: int) -> dict[str, int]:
    return {"run": run, "double": 2 * run + seed}

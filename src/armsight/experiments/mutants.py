"""``mutants``: mistakes in our own code, and the tests that have to notice them."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from armsight.errors import UsageError
from armsight.experiments.episodes import run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.mutation import VARIABLE, Mutant, mutant, sites
from armsight.experiments.rows import Row, wilson

LONGEST = 900.0
"""Tests that take longer than this count as having noticed: the mutant made them go round [s]."""
PARTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "guard": (
        ("motion.guard", "motion.faults", "motion.looking", "motion.reflex", "motion.arm_model"),
        ("motion/test_proof_terms.py", "motion/test_arm_model.py", "motion/test_guard_parts.py",
         "motion/test_guard_faults.py", "motion/test_guard.py"),
    ),
    "gate": (
        ("motion.velocity_filter", "motion.nearest", "motion.steering"),
        ("motion/test_proof_terms.py", "motion/test_guard_parts.py", "motion/test_steering.py",
         "motion/test_guard.py"),
    ),
    "separation": (
        ("motion.separation", "motion.separation_monitor", "motion.guard_kernels"),
        ("motion/test_separation.py", "motion/test_guard_kernels.py", "motion/test_proof_terms.py",
         "motion/test_guard.py"),
    ),
    "permits": (
        ("motion.permits", "motion.permit_office", "motion.permitted", "motion.contact_speed",
         "motion.contact_limits", "motion.force_watch", "motion.retreat", "motion.regions"),
        ("motion/test_permits.py", "motion/test_contact.py"),
    ),
    "hazards": (
        ("mapping.hazards", "mapping.things", "mapping.tracked", "mapping.people"),
        ("mapping/test_hazards_oracle.py", "mapping/test_flood.py", "mapping/test_tracked.py",
         "mapping/test_things.py", "mapping/test_workspace_map.py"),
    ),
    "self-filter": (
        ("mapping.self_filter",),
        ("mapping/test_beside_the_arm.py", "mapping/test_workspace_map.py",
         "mapping/test_merged_clouds.py"),
    ),
    "map": (
        ("mapping.occupancy", "mapping.carving", "mapping.workspace_map", "mapping.camera_stage",
         "mapping.health", "mapping.plausibility"),
        ("mapping/test_bad_frames.py", "mapping/test_clearing.py", "mapping/test_map_oracle.py",
         "mapping/test_plausibility.py", "mapping/test_workspace_map.py"),
    ),
}  # fmt: skip
"""Modules of each part, and the tests that look at them, quickest first."""

ABOUT = """
One mistake at a time in the guard, its gate, separation, permits, hazards, self-filter and map: a
comparison turned round, a sign flipped, a minimum made a maximum, an `and` an `or`, a term of a sum
dropped. The mutants are drawn at random from all that there are, as many from each part. Each is
imported in place of its module by a fresh interpreter, which runs that part's tests; compiled code
is compiled anew. A mutant that no test notices survives. Some survivors change nothing that
matters (a message, a bound that another bound hides): they count as survivors all the same.
"""


def drawn(part: str, seed: int, number: int) -> tuple[str, Mutant]:
    """The module and the mutant of that number of a part, in a random order of all there are."""
    sources = {module: _source(module).read_text("utf-8") for module in PARTS[part][0]}
    places = [(module, site) for module, text in sources.items() for site in sites(text)]
    rng = np.random.default_rng((seed, *map(ord, part)))
    module, site = places[int(rng.permutation(len(places))[number % len(places)])]
    return module, mutant(sources[module], site)


def _source(module: str) -> Path:
    import armsight

    return Path(armsight.__file__).parent / f"{module.replace('.', '/')}.py"


def episode(seed: int, run: int) -> dict[str, Any]:
    """One mutant; module-level, so that worker processes can import it."""
    names = list(PARTS)
    part = names[run % len(names)]
    module, changed = drawn(part, seed, run // len(names))
    with tempfile.TemporaryDirectory(prefix="armsight-mutant-") as folder:
        file = Path(folder) / f"{module.rpartition('.')[2]}.py"
        file.write_text(changed.source, encoding="utf-8")
        noticed = _noticed(part, f"armsight.{module}", file)
    return {
        "part": part,
        "where": f"{module}:{changed.line}",
        "what": changed.what,
        "noticed": noticed,
    }


def _noticed(part: str, module: str, file: Path) -> str:
    """The first test that a mutant fails, "hangs" or "breaks"; empty when it survives."""
    tests = _tests()
    environment = {**os.environ, VARIABLE: f"{module}={file}"}
    if "njit" in file.read_text("utf-8"):  # what others compiled it into must not be used
        environment["NUMBA_CACHE_DIR"] = str(file.parent)
    command = [
        sys.executable, "-B", "-m", "pytest", "-x", "-q", "--no-header", "--tb=no",
        "-p", "armsight.experiments.mutation", "-p", "no:cacheprovider",
        *(str(tests / name) for name in PARTS[part][1]),
    ]  # fmt: skip
    try:
        done = subprocess.run(  # noqa: S603 - our own tests, no shell
            command, cwd=tests.parent, env=environment, timeout=LONGEST,
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "hangs"
    if done.returncode == 0:
        return ""
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0].split(" - ")[0].rpartition("/")[2] if failed else "breaks"


def _tests() -> Path:
    """The folder of the tests.

    Raises:
        UsageError: this is no source checkout.
    """
    folder = Path(__file__).resolve().parents[3] / "tests"
    if not (folder / "motion").is_dir():
        raise UsageError("mutants: there are no tests beside this package; run it in a checkout")
    return folder


def settings() -> dict[str, Any]:
    """All that changes a run, besides its seed: the modules and their tests as they are."""
    digest = hashlib.sha256()
    for modules, tests in PARTS.values():
        for name in modules:
            digest.update(_source(name).read_bytes())
        for name in tests:
            digest.update((_tests() / name).read_bytes())
    return {"code": digest.hexdigest()}


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` mutants, as many of each part."""
    for part in PARTS:
        progress(f"mutants: the tests of {part} without a mutant", 0.0)
        broken = _noticed(part, "armsight.none", Path(__file__).with_name("mutation.py"))
        if broken:
            raise UsageError(f"mutants: {broken} fails without a mutant")
    results = run_episodes("mutants", episode, range(runs), seed, settings(), progress)
    rows = [_row("mutants_killed", "all", results, must=0.9, aim=0.97)]
    rows += [_row("killed", p, [r for r in results if r["part"] == p]) for p in PARTS]
    lived = [f"Survives: {r['where']}: `{r['what']}`." for r in results if not r["noticed"]]
    return Outcome(tuple(rows), {}, tuple(lived))


def _row(
    key: str,
    condition: str,
    results: list[dict[str, Any]],
    must: float | None = None,
    aim: float | None = None,
) -> Row:
    killed = sum(bool(r["noticed"]) for r in results)
    low, high = wilson(killed, len(results))
    share = killed / max(len(results), 1)
    return Row(
        key, "share of mutants that a test notices (95 % bounds)", condition, share,
        n=len(results), low=low, high=high, must=must, aim=aim, better="higher",
    )  # fmt: skip


EXPERIMENT = Experiment(
    "mutants", "mistakes in our own code, and the tests that notice them", run, 210, ABOUT
)

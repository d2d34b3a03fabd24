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
from armsight.experiments.cache import cache_folder
from armsight.experiments.code_digest import digest_of
from armsight.experiments.covered import VARIABLE as COVERED
from armsight.experiments.covered import Covered, read, together
from armsight.experiments.episodes import run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.mutation import VARIABLE as MUTANT
from armsight.experiments.mutation import Mutant, mutant, sites
from armsight.experiments.rows import Row, share_row

LONGEST = 600.0
"""Tests that take longer than this count as having noticed: the mutant made them go round [s]."""
ENOUGH = 40.0
"""Tests of a mutant, quickest first, end where all of them together would take this long [s]."""
ROOMS = ("motion", "mapping")
"""Folders of tests; those of a room look at the room's modules."""
PARTS: dict[str, tuple[str, ...]] = {
    "guard": ("motion.guard", "motion.faults", "motion.looking", "motion.reflex",
              "motion.arm_model"),
    "gate": ("motion.velocity_filter", "motion.nearest", "motion.steering"),
    "separation": ("motion.separation", "motion.separation_monitor", "motion.separation_kernels",
                   "motion.hazard_kernels", "motion.drive_kernels", "motion.slide_kernels"),
    "permits": ("motion.permits", "motion.permit_office", "motion.permitted",
                "motion.contact_speed", "motion.contact_limits", "motion.force_watch",
                "motion.retreat", "motion.regions"),
    "hazards": ("mapping.hazards", "mapping.things", "mapping.tracked", "mapping.people"),
    "self-filter": ("mapping.self_filter",),
    "map": ("mapping.occupancy", "mapping.carving", "mapping.workspace_map",
            "mapping.camera_stage", "mapping.health", "mapping.plausibility"),
}  # fmt: skip
"""Modules of each part."""
COMPILED: dict[str, tuple[str, ...]] = {
    "motion.separation_kernels": ("test_separation.py", "test_separation_kernels.py"),
    "motion.hazard_kernels": ("test_separation_kernels.py", "test_proof_terms.py"),
    "motion.drive_kernels": ("test_separation_kernels.py", "test_arm_model.py",
                             "test_proof_terms.py"),
    "motion.slide_kernels": ("test_separation_kernels.py", "test_steering.py"),
}  # fmt: skip
"""Tests of modules whose functions are compiled: nobody sees which lines of them run."""

NJIT = "@njit"

ABOUT = """
One mistake at a time in the guard, its gate, separation, permits, hazards, self-filter and map: a
comparison turned round, a sign flipped, a minimum made a maximum, an `and` an `or`, a term of a sum
dropped. The mutants are drawn at random from all that there are, as many from each part. Each is
imported in place of its module by a fresh interpreter, which runs those tests of its room
(`tests/motion`, `tests/mapping`) that run the changed line, quickest first, at most 40 s of them;
compiled code is compiled anew. A mutant that none of these tests notices survives, also where no
test runs its line. What only words can show is no mutant: messages, and names and functions of
which nothing but words is made. Some survivors change nothing that matters (a bound that another
bound hides): they count as survivors all the same.
"""


def drawn(part: str, seed: int, number: int) -> tuple[str, Mutant]:
    """The module and the mutant of that number of a part, in a random order of all there are."""
    sources = {module: _source(module).read_text("utf-8") for module in PARTS[part]}
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
    return {
        "part": part,
        "where": f"{module}:{changed.line}",
        "what": changed.what,
        "noticed": _noticed(module, changed, _looking(module, changed)),
    }


def _looking(module: str, changed: Mutant) -> list[str]:
    """The tests that run what was changed, quickest first; of compiled modules all their own."""
    room = module.partition(".")[0]
    if module in COMPILED:
        return [f"tests/{room}/{name}" for name in COMPILED[module]]
    covered = _covered(room)
    chosen: list[str] = []
    seconds = 0.0
    for test in covered.tests(f"armsight.{module}", changed.line, changed.last):
        seconds += covered.seconds[test]
        if chosen and seconds > ENOUGH:
            break
        chosen.append(test)
    return chosen


def _compiled_into_others(module: str) -> bool:
    """Whether functions of a module are compiled into those of another."""
    folder = _source(module).parent
    kernels = [text for text in (f.read_text("utf-8") for f in folder.glob("*.py")) if NJIT in text]
    return any(f"from armsight.{module} import" in text for text in kernels)


def _noticed(module: str, changed: Mutant, tests: list[str]) -> str:
    """The first test that a mutant fails, "hangs" or "breaks"; empty when it survives."""
    if not tests:
        return ""
    with tempfile.TemporaryDirectory(prefix="armsight-mutant-") as folder:
        file = Path(folder) / f"{module.rpartition('.')[2]}.py"
        file.write_text(changed.source, encoding="utf-8")
        environment = {MUTANT: f"armsight.{module}={file}"}
        if _compiled_into_others(module):  # what they were compiled to must not be used
            environment["NUMBA_CACHE_DIR"] = folder
        try:
            done = _pytest("mutation", environment, tests, LONGEST)
        except subprocess.TimeoutExpired:
            return "hangs"
    if done.returncode == 0:
        return ""
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0].split(" - ")[0].rpartition("/")[2] if failed else "breaks"


def _pytest(
    plugin: str, environment: dict[str, str], tests: list[str], longest: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Tests of the checkout in a fresh interpreter, with a plugin of ours."""
    command = [
        sys.executable, "-B", "-m", "pytest", "-x", "-q", "--no-header", "--tb=no",
        "-p", f"armsight.experiments.{plugin}", "-p", "no:cacheprovider", *tests,
    ]  # fmt: skip
    return subprocess.run(  # noqa: S603 - our own tests, no shell
        command, cwd=_tests().parent, env={**os.environ, **environment}, timeout=longest,
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def _cover(room: str, progress: Progress) -> None:
    """Run a room's tests once, without a mutant, to see which lines they run; file by file.

    Raises:
        UsageError: a test fails without a mutant.
    """
    modules = [f"armsight.{module}" for module in _modules(room)]
    for file in _test_files(room):
        covered = _covered_file(room, file)
        if covered.exists():
            continue
        progress(f"mutants: {room}/{file.name} without a mutant", 0.0)
        covered.parent.mkdir(parents=True, exist_ok=True)
        done = _pytest(
            "covered", {COVERED: f"{covered}={','.join(modules)}"}, [f"tests/{room}/{file.name}"]
        )
        if done.returncode:
            covered.unlink(missing_ok=True)
            told = done.stdout[-200:]
            raise UsageError(f"mutants: tests/{room}/{file.name} fails without a mutant: {told}")


def _covered(room: str) -> Covered:
    """Which lines the tests of a room run."""
    return together(read(_covered_file(room, file)) for file in _test_files(room))


def _covered_file(room: str, file: Path) -> Path:
    """Where it is kept which lines of its room one file of tests runs, as both are now."""
    helpers = [f for f in (_tests() / room).glob("*.py") if not f.name.startswith("test_")]
    digest = _digest([*map(_source, _modules(room)), *sorted(helpers), file])
    return cache_folder().resolve() / "mutants" / f"{room}-{file.stem}-{digest[:12]}.json"


def _modules(room: str) -> list[str]:
    return [m for part in PARTS.values() for m in part if m.startswith(f"{room}.")]


def _test_files(room: str) -> list[Path]:
    return sorted((_tests() / room).glob("test_*.py"))


def _tests() -> Path:
    """The folder of the tests.

    Raises:
        UsageError: this is no source checkout.
    """
    folder = Path(__file__).resolve().parents[3] / "tests"
    if not (folder / "motion").is_dir():
        raise UsageError("mutants: there are no tests beside this package; run it in a checkout")
    return folder


def _digest(files: list[Path]) -> str:
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` mutants, as many of each part."""
    for room in ROOMS:
        _cover(room, progress)
    tests = [digest_of(_tests() / room) for room in ROOMS]
    results = run_episodes("mutants", episode, range(runs), seed, progress, tests)
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
    what = "share of mutants that a test notices (95 % bounds)"
    return share_row(key, what, condition, killed, len(results), None, must, aim, "higher")


EXPERIMENT = Experiment(
    "mutants", "mistakes in our own code, and the tests that notice them", run, 210, ABOUT
)

"""Who may import whom: contracts, no circles of files; and where compiled kernels are."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "src" / "armsight"


def test_imports_keep_the_contracts(capsys):
    kept = lint_imports(config_filename=str(ROOT / "pyproject.toml"), is_debug_mode=False)
    assert kept == EXIT_STATUS_SUCCESS, capsys.readouterr().out


def circle(imports: dict[str, set[str]]) -> list[str]:
    """The files of one circle, in order, or none."""
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_circle_of_files():
    graph = grimp.build_graph("armsight", exclude_type_checking_imports=True)
    found = circle({m: graph.find_modules_directly_imported_by(m) for m in graph.modules})
    assert not found, " <- ".join(found)


def test_a_circle_would_be_found():
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})) == {"a", "b", "c"}


def is_kernel_file(file: Path) -> bool:
    """Whether hot loops belong into this file."""
    return "kernels" in file.parent.parts or file.stem.endswith("kernels")


def uses_numba(text: str) -> bool:
    """Whether a file compiles functions: names ``njit``, ``jit`` or ``vectorize`` of numba."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "numba":
            return True
        if isinstance(node, ast.Import) and any(
            a.name.split(".")[0] == "numba" for a in node.names
        ):
            return True
    return False


TO_MOVE = {
    "motion/obstacles.py",
}
"""Older files with hot loops among the rest. None is added; one that is moved leaves this list."""


def test_hot_loops_are_in_kernel_files_only():
    elsewhere = {
        str(f.relative_to(SOURCE))
        for f in sorted(SOURCE.rglob("*.py"))
        if not is_kernel_file(f.relative_to(SOURCE)) and uses_numba(f.read_text(encoding="utf-8"))
    }
    assert elsewhere == TO_MOVE, "what numba compiles belongs into a kernels file of its room"


@pytest.mark.parametrize(
    ("text", "compiled"),
    [("import numba", True), ("from numba import njit", True), ("import numpy", False)],
)
def test_numba_is_seen(text, compiled):
    assert uses_numba(text) is compiled

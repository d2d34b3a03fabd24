"""Who may import whom: the contracts of pyproject.toml, and no circles of files."""

from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
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

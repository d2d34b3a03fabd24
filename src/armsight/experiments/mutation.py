"""Mistakes that somebody could make in our own code, one at a time: an AST mutation tester.

Each mutant of a module has one comparison turned round, one sign flipped, one minimum made a
maximum (or one ``and`` an ``or``), or one term of a sum dropped (DeMillo, Lipton, Sayward 1978). A
fresh interpreter imports it instead of the module and runs that module's tests: a mutant that they
let pass stands for a term that nobody looks at.

``python -m pytest -p armsight.experiments.mutation`` with ``ARMSIGHT_MUTANT=module=file`` does the
importing; nothing in the source tree is ever changed.
"""

from __future__ import annotations

import ast
import importlib.abc
import importlib.util
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.machinery import ModuleSpec
from types import ModuleType

VARIABLE = "ARMSIGHT_MUTANT"
"""``module=file``: the module to replace, and the file with its mutant."""
TURNED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
EXTREMES = {
    "min": "max",
    "max": "min",
    "minimum": "maximum",
    "maximum": "minimum",
    "argmin": "argmax",
    "argmax": "argmin",
    "any": "all",
    "all": "any",
}


@dataclass(frozen=True)
class Mutant:
    """One change.

    Attributes:
        line, last: of the source, from 1, where what was changed begins and ends.
        what: was changed into what, in words.
        source: of the whole module, changed.
    """

    line: int
    last: int
    what: str
    source: str


def sites(source: str) -> list[tuple[int, int]]:
    """All places of a module's source in which a mistake could be: what :func:`mutant` is told.

    What only words can show is left alone, for a mistake there is none in what the code does:
    docstrings, f-strings, what is raised, annotations, bodies of ``__str__`` and of functions that
    only speak (:func:`_only_speaks`), and names that nothing but such words are made of.
    """
    nodes = _code(ast.parse(source))
    return [(index, kind) for index, node in enumerate(nodes) for kind in range(_kinds(node))]


def mutant(source: str, site: tuple[int, int]) -> Mutant:
    """The mutant of a module's source at one of its :func:`sites`."""
    tree = ast.parse(source)
    node = next(n for i, n in enumerate(_code(tree)) if i == site[0])
    before, line = ast.unparse(node), getattr(node, "lineno", 0)
    last = getattr(node, "end_lineno", line)
    after = _change(node, site[1])
    what = f"{before} -> {ast.unparse(after)}"
    changed = ast.fix_missing_locations(_Replace(node, after).visit(tree))
    return Mutant(line, last, what, ast.unparse(changed))


def _code(tree: ast.AST, words: frozenset[str] = frozenset()) -> Iterator[ast.AST]:
    """The expressions of a tree that decide something, in a fixed order.

    Args:
        tree: to look through.
        words: names that only serve to say something, in the function around.
    """
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for child in value if isinstance(value, list) else [value]:
            inner = words
            if isinstance(child, ast.FunctionDef):
                if child.name in ("__str__", "__repr__") or _only_speaks(child):
                    continue
                inner = _words(child)
            if not isinstance(child, ast.AST) or isinstance(child, ast.JoinedStr | ast.Raise):
                continue
            if isinstance(child, ast.Assign) and _names(child) & words:
                continue
            yield child
            yield from _code(child, inner)


def _only_speaks(function: ast.FunctionDef) -> bool:
    """Whether a function's result is words whatever it finds, never none, and its only effect.

    One that returns an empty text where all is well decides something.
    """
    if not (isinstance(function.returns, ast.Name) and function.returns.id == "str"):
        return False
    nodes = list(ast.walk(function))
    said = [n.value for n in nodes if isinstance(n, ast.Return)]
    stores = (n for n in nodes if isinstance(n, ast.Attribute | ast.Subscript))
    return all(map(_text, said)) and not any(isinstance(n.ctx, ast.Store) for n in stores)


def _text(value: ast.AST | None) -> bool:
    """Whether an expression is a text that is never empty."""
    if isinstance(value, ast.JoinedStr):
        return any(map(_text, value.values))
    return isinstance(value, ast.Constant) and isinstance(value.value, str) and bool(value.value)


def _words(function: ast.FunctionDef) -> frozenset[str]:
    """The names in a function that are read in f-strings and in what is raised, nowhere else.

    And those of which nothing but such names are made.
    """
    assigned = [n for n in ast.walk(function) if isinstance(n, ast.Assign) and _names(n)]
    words: frozenset[str] = frozenset().union(*map(_names, assigned))
    while True:
        read = _read(function, words)
        fewer = frozenset(name for name in words if name not in read)
        fewer -= {n for a in assigned for n in _names(a) if not _names(a) <= fewer}
        if fewer == words:
            return words
        words = fewer


def _names(assignment: ast.Assign) -> frozenset[str]:
    """The plain names that an assignment sets; none where it sets anything else."""
    targets = [e for t in assignment.targets for e in (t.elts if isinstance(t, ast.Tuple) else [t])]
    plain = [t.id for t in targets if isinstance(t, ast.Name)]
    return frozenset(plain) if len(plain) == len(targets) else frozenset()


def _read(tree: ast.AST, words: frozenset[str]) -> set[str]:
    """The names that a tree reads for more than words."""
    found: set[str] = set()
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.JoinedStr | ast.Raise):
            continue
        if isinstance(child, ast.Assign) and _names(child) and _names(child) <= words:
            continue
        if isinstance(child, ast.Name) and isinstance(child.ctx, ast.Load):
            found.add(child.id)
        found |= _read(child, words)
    return found


def _kinds(node: ast.AST) -> int:
    """How many changes a node has."""
    if isinstance(node, ast.Compare):
        return len(node.ops)
    if isinstance(node, ast.BoolOp):
        return 1
    if isinstance(node, ast.UnaryOp):
        return int(isinstance(node.op, ast.USub | ast.Not))
    if isinstance(node, ast.BinOp):
        text = any(isinstance(side, ast.Constant | ast.JoinedStr) and not _number(side)
                   for side in (node.left, node.right))  # fmt: skip
        return 0 if text else 2 * int(isinstance(node.op, ast.Add | ast.Sub))
    return int(isinstance(node, ast.Call) and _called(node) in EXTREMES)


def _number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float)


def _called(node: ast.Call) -> str:
    function = node.func
    return function.id if isinstance(function, ast.Name) else getattr(function, "attr", "")


def _change(node: ast.AST, kind: int) -> ast.AST:
    """What a node becomes."""
    if isinstance(node, ast.Compare):
        ops = list(node.ops)
        ops[kind] = TURNED[type(ops[kind])]()
        return ast.Compare(node.left, ops, node.comparators)
    if isinstance(node, ast.BoolOp):
        return ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    if isinstance(node, ast.UnaryOp):
        return node.operand
    if isinstance(node, ast.BinOp):
        if kind == 1:
            return node.left
        other = ast.Sub() if isinstance(node.op, ast.Add) else ast.Add()
        return ast.BinOp(node.left, other, node.right)
    assert isinstance(node, ast.Call)
    new = EXTREMES[_called(node)]
    function = node.func
    if isinstance(function, ast.Name):
        return ast.Call(ast.Name(new, ast.Load()), node.args, node.keywords)
    assert isinstance(function, ast.Attribute)
    return ast.Call(ast.Attribute(function.value, new, ast.Load()), node.args, node.keywords)


class _Replace(ast.NodeTransformer):
    """Puts one node in another's place."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        """Called for every node."""
        return self._new if node is self._old else self.generic_visit(node)


class _Instead(importlib.abc.MetaPathFinder):
    """Finds one module in another file."""

    def __init__(self, module: str, file: str) -> None:
        self._module, self._file = module, file

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Called by the import system."""
        if name != self._module:
            return None
        return importlib.util.spec_from_file_location(name, self._file)


def pytest_configure() -> None:
    """Called by pytest: from now on the mutant is imported instead of its module.

    Raises:
        RuntimeError: the module has been imported already, so its tests would say nothing.
    """
    told = os.environ.get(VARIABLE, "")
    if not told:
        return
    module, _, file = told.partition("=")
    if module in sys.modules:
        raise RuntimeError(f"{module} was imported before its mutant could take its place")
    sys.meta_path.insert(0, _Instead(module, file))

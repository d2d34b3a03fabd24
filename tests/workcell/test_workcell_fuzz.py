"""Whatever stands in the file, the answer is a cell or a WorkcellError of single lines."""

import copy
import datetime
import tomllib

import tomlkit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from armsight.errors import WorkcellError
from armsight.workcell import parse_workcell
from armsight.workcell.packaged import packaged

CELL = tomllib.loads(packaged()["ur5_four_cameras"].read_text(encoding="utf-8"))

numbers = st.one_of(
    st.integers(-(2**62), 2**62),
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0, 0.0, 1, -1, 1e-300, 1e300, 3.14159, 90, 1500]),
)
plain = st.one_of(
    numbers,
    st.booleans(),
    st.text(alphabet=st.characters(blacklist_categories=("Cs", "Cc")), max_size=12),
    st.just(datetime.date(2020, 1, 1)),
)
values = st.recursive(
    plain,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.sampled_from(["name", "position", "x y", "rate_hz"]), inner, max_size=3),
    ),
    max_leaves=6,
)


def places(node, path=()):
    """Paths of everything in a document."""
    items = node.items() if isinstance(node, dict) else enumerate(node)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from places(value, (*path, key))


PLACES = list(places(CELL))


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(st.sampled_from(PLACES), values), min_size=1, max_size=4))
def test_any_value_anywhere(changes):
    document = copy.deepcopy(CELL)
    for path, value in changes:
        node = document
        try:
            for step in path[:-1]:
                node = node[step]
            if isinstance(node, dict) != isinstance(path[-1], str):
                continue  # an earlier change put something else here
            node[path[-1]] = value
        except (KeyError, IndexError, TypeError):
            continue
    answered(tomlkit.dumps(document))


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=200))
def test_any_text(text):
    answered(text)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 4000), st.integers(1, 400))
def test_any_cut(start, length):
    text = packaged()["ur5_four_cameras"].read_text(encoding="utf-8")
    answered(text[:start] + text[start + length :])


def answered(text):
    try:
        parse_workcell(text, "f.toml")
    except WorkcellError as error:
        lines = str(error).splitlines()
        assert lines
        assert all(line.startswith("f.toml: ") and len(line) < 600 for line in lines)

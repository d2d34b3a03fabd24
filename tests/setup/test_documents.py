"""The documents: whole, linked, and naming what is there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import armsight

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [*sorted(DOCS.rglob("*.md")), *sorted(ROOT.glob("*.md"))]


def test_every_page_is_in_the_site():
    listed = set(re.findall(r"^   ([a-z_]+)$", (DOCS / "contents.rst").read_text(), re.MULTILINE))
    assert listed == {page.stem for page in DOCS.glob("*.md")}


def test_the_first_names_are_on_their_page():
    shown = re.findall(r":: armsight\.(\w+)", (DOCS / "api.md").read_text())
    assert sorted(shown) == sorted(set(armsight.__all__) - {"__version__"})


def test_the_readme_has_the_figures_that_are_published():
    script = [sys.executable, str(ROOT / "scripts/readme_figures.py"), "--check"]
    assert subprocess.run(script, check=False).returncode == 0, "run scripts/readme_figures.py"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        path = target.partition("#")[0]
        if path and not re.match(r"[a-z]+:", path):
            assert (page.parent / path).exists(), f"{page.name} links to {target}"


def test_sources_named_in_the_bibliography_exist():
    text = (DOCS / "bibliography.md").read_text(encoding="utf-8")
    for name in re.findall(r"`([a-z_]+/[a-z_/]+\.py)`", text):
        assert (ROOT / "src" / "armsight" / name).is_file(), name


def test_keys_of_papers_are_explained():
    """T1 to T7 and V are short for works; whoever meets one in a file finds it on one page."""
    explained = set(re.findall(r"^\| (T\d?|V) \|", (DOCS / "bibliography.md").read_text(), re.M))
    assert explained == {"T", *(f"T{k}" for k in range(1, 8)), "V"}


def sources():
    for folder in ("src", "examples", "benchmarks", "scripts"):
        yield from sorted((ROOT / folder).rglob("*.py"))
    yield from PAGES


def test_nothing_is_cited_that_is_not_here():
    """No page of anybody's desk: what a file refers to is in the repository or on a shelf."""
    for file in sources():
        text = file.read_text(encoding="utf-8")
        assert not re.search(r"\bdesign page|`?shared/design", text), file

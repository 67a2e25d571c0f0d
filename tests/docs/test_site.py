"""The site of all pages: it is built without a warning, every page is in its navigation, and
nothing is fetched from anywhere.
"""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import DECISIONS, PATHS, TOP

DOCS = TOP / "docs"
BUILDER = ["sphinx", "myst_parser", "furo"]
needs_builder = pytest.mark.skipif(
    any(importlib.util.find_spec(each) is None for each in BUILDER),
    reason="the extra 'docs' is not installed",
)
FETCHED = re.compile(
    r"""<(?:script|img|iframe|source|video|audio|embed)[^>]*\ssrc="((?:https?:)?//[^"]*)"
    |<link[^>]*\shref="((?:https?:)?//[^"]*)"
    |(?:url\(|@import\s)\s*["']?((?:https?:)?//[^"')]*)""",
    re.VERBOSE,
)


def built(docs: Path, site: Path) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]
    return subprocess.run(
        [*line, "-c", str(docs / "site"), str(docs), str(site)],
        capture_output=True,
        text=True,
        check=False,
    )


def test_every_page_is_in_the_contents() -> None:
    pages = {path.name for path in PATHS} - {"README.md", "index.md"}
    assert listed(DOCS / "index.md") == sorted(pages | {"decisions/index.md"})
    topics = {path.name for path in DECISIONS} - {"index.md"}
    assert listed(DOCS / "decisions" / "index.md") == sorted(topics)


def listed(page: Path) -> list[str]:
    """The pages that a page lists, one a line."""
    text = page.read_text("utf-8")
    return sorted(re.findall(r"^- \[[^\]]*\]\(([\w/-]+\.md)\)$", text, re.MULTILINE))


@needs_builder
@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_fetches_nothing(tmp_path: Path) -> None:
    ran = built(DOCS, tmp_path / "site")
    assert (ran.returncode, ran.stderr) == (0, "")
    made = [path for path in (tmp_path / "site").rglob("*") if path.suffix in (".html", ".css")]
    assert len(made) > 30
    found = {
        address
        for path in made
        for match in FETCHED.findall(path.read_text("utf-8"))
        for address in match
        if address
    }
    assert found == set()
    # search needs no server
    assert "regrasp" in (tmp_path / "site" / "searchindex.js").read_text("utf-8")


@needs_builder
@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "wrong"),
    [
        ("[there](nowhere.md)\n", "nowhere.md"),
        ("[there](index.md#no-such-part)\n", "no-such-part"),
        ("", "lost.md"),
    ],
)
def test_a_broken_link_or_a_lost_page_is_refused(tmp_path: Path, page: str, wrong: str) -> None:
    docs = tmp_path / "docs"
    (docs / "site" / "static").mkdir(parents=True)
    (docs / "site" / "conf.py").write_bytes((DOCS / "site" / "conf.py").read_bytes())
    (docs / "index.md").write_text("# Contents\n\n## Part\n\n- [One](one.md)\n", "utf-8")
    (docs / "one.md").write_text(f"# One\n\n{page}", "utf-8")
    if wrong == "lost.md":
        (docs / "lost.md").write_text("# Lost\n", "utf-8")
    ran = built(docs, tmp_path / "site")
    assert ran.returncode != 0
    assert wrong in ran.stderr


@pytest.mark.parametrize(
    ("text", "fetched"),
    [
        ('<script src="https://cdn.example/x.js"></script>', True),
        ('<link rel="stylesheet" href="//fonts.example/a.css">', True),
        ("@import 'https://fonts.example/a.css'", True),
        ("src: url(https://fonts.example/a.woff)", True),
        ('<a href="https://example.org">there</a>', False),
        ('<script src="_static/x.js"></script>', False),
    ],
)
def test_what_a_page_fetches_is_told_from_what_it_links(text: str, fetched: bool) -> None:
    assert bool(FETCHED.search(text)) is fetched

"""An operator's walk, from the start of a run to its replay; what the pages tell on the way is
golden.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import Golden
from tests.engine.faces.monitor.conftest import Serve, at, started

TIME = re.compile(r"\d[\d.]*( ms| s| min| h)( \d+ (s|min))?")


def rows(page: Any, view: str) -> list[str]:
    """The rows of the tables of a view, without times, each once."""
    at(page, f"tab-{view}").click()
    shown = at(page, f"shows-{view}").locator("tbody tr")
    shown.first.wait_for()
    told = (
        TIME.sub("_", " | ".join(each.split("\t")))
        for each in shown.all_inner_texts()
        if each.strip()
    )
    return list(dict.fromkeys(told))  # while a table changes, rows may be there twice


@pytest.mark.slow
def test_an_operators_walk(
    open_page: Callable[[str], Any], serve: Serve, tmp_path: Path, golden: Golden
) -> None:
    """Start THEMSE with four probes; the drawer jams; answer; recover; look at the results;
    replay.
    """
    page = open_page(serve(tmp_path / "runs.db", tmp_path))
    started(page, target="themse/four", name="walk", factor="0.005", fault="1=drawer_blocked")
    told = list[str]()
    banner = at(page, "asks", has_text="clear the rails")
    banner.wait_for()
    told += [
        "Asked, while it stands",
        at(page, "phase").inner_text(),
        *banner.inner_text().split("\n"),
    ]
    at(page, "choice-cured").click()
    at(page, "phase", has_text="reached").wait_for()
    told += ["Diagnosis", *rows(page, "diagnosis")]
    at(page, "tab-results").click()
    at(page, "shows-results", has_text="nothing was measured").wait_for()
    told += ["What was done first", *rows(page, "objects")[:1]]
    at(page, "tab-now").click()
    goals = at(page, "shows-now").locator("tr")
    goals.filter(has_text="✓ reached").first.wait_for()
    goals.filter(has_text="○ open").first.wait_for(state="detached")
    told += ["Goals", *rows(page, "now")]
    page.keyboard.press("x")
    at(page, "phase", has_text="quiescing").wait_for()
    told += ["Back at the exception", *rows(page, "log")[:1]]
    at(page, "play").click()
    at(page, "phase", has_text="handling").wait_for()
    page.keyboard.press("l")
    at(page, "phase", has_text="reached").wait_for()
    golden("operators_walk.txt", "\n".join(told) + "\n")

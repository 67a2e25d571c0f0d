"""An operator's walk, from the start of a run to its replay; what the pages tell on the way is golden."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import Golden
from tests.engine.faces.monitor.conftest import Serve, at, started

TIME = re.compile(r"\d[\d.]*( ms| s| min| h)( \d+ (s|min))?")
PHASE = '[data-testid="phase"]'


def rows(page: Any, view: str) -> list[str]:
    """The rows of the tables of a view, without times, each once."""
    at(page, f"tab-{view}").click()
    page.locator(".q-tab-panel:visible tbody td").first.wait_for()
    shown = page.locator(".q-tab-panel:visible tbody tr").all_inner_texts()
    return list(dict.fromkeys(TIME.sub("_", " | ".join(each.split("\t"))) for each in shown if each.strip()))


@pytest.mark.slow
def test_an_operators_walk(
    open_page: Callable[[str], Any], serve: Serve, tmp_path: Path, golden: Golden
) -> None:
    """Start THEMSE with four probes; a lid jams; answer; recover; look at the results; replay."""
    page = open_page(serve(tmp_path / "runs.db", tmp_path))
    told = [
        "Approve",
        *started(page, target="themse/four", name="walk", factor="0.001", fault="3=lid_jammed"),
    ]
    banner = at(page, "asks", has_text="clear the rails")
    banner.wait_for()
    told += ["Asked, while it stands", at(page, "phase").inner_text(), *banner.inner_text().split("\n")]
    at(page, "choice-cured").click()
    at(page, "phase", has_text="reached").wait_for()
    told += ["Diagnosis", *rows(page, "diagnosis")]
    told += ["Results", *rows(page, "results")]
    told += ["Goals", *rows(page, "now")]
    page.keyboard.press("x")
    at(page, "phase", has_text="quiescing").wait_for()
    told += ["Back at the exception", *rows(page, "log")[:3]]
    at(page, "play").click()
    at(page, "phase", has_text="handling").wait_for()
    page.keyboard.press("l")
    at(page, "phase", has_text="reached").wait_for()
    golden("operators_walk.txt", "\n".join(told) + "\n")

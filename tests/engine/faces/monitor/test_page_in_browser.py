"""Pages of runs that are over: views, replay, what is chosen, the arm where the journal puts
it, and nothing from elsewhere.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellwright.engine.faces.monitor.run_follower import RunFollower
from cellwright.engine.pipelines.execution.journal_motions import (
    RestingCell,
    Retracing,
    world_during,
)
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.pictures.viewer_files import body_poses
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.store.journal import Journal, JournalLine
from tests.engine.faces.monitor.conftest import Serve, at, run_there

pytestmark = pytest.mark.slow
Open = Callable[[str], Any]
TARGET = "themse/in_furnace"


@pytest.fixture(scope="module")
def store(serve: Serve, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: ARG001 - nothing runs without a browser
    made = tmp_path_factory.mktemp("store") / "runs.db"
    run_there(made, TARGET, "--name", "monday", "--fault", "pick=not_gripped")
    run_there(made, TARGET, "--name", "tuesday")
    return made


@pytest.fixture(scope="module")
def site(serve: Serve, store: Path) -> str:
    return serve(store, store.parent)


def test_every_view_shows_the_run_and_nothing_comes_from_elsewhere(
    open_page: Open, site: str
) -> None:
    page = open_page(f"{site}/run/monday")
    page.wait_for_selector("svg .step")
    wanted = {
        "plan": "pick(", "world": "stored", "states": "mars_gripper", "sequence": "measures "
        "nothing", "diagnosis": "grip_again",
        "results": "of", "objects": "pick(", "log": "EXCEPTION", "compare": "the other "
        "run", "cell": "touch",
    }  # fmt: skip
    for name, text in wanted.items():
        at(page, f"tab-{name}").click()
        page.locator(".q-tab-panel:visible", has_text=text).first.wait_for()
    at(page, "tab-diagnosis").click()
    at(page, "tree").click()
    page.locator('[data-testid="decision-tree"] svg').wait_for()
    assert [each for each in page.asked if not each.startswith((site, "data:", "blob:"))] == []


def test_the_page_goes_to_the_exception_and_tells_of_a_chosen_step_why_it_is_there(
    open_page: Open, site: str
) -> None:
    page = open_page(f"{site}/run/monday")
    page.keyboard.press("x")
    at(page, "phase", has_text="quiescing").wait_for()
    page.locator('.step[data-step^="pick"]').last.click()
    at(page, "chosen", has_text="waits for:").wait_for()
    at(page, "because").first.wait_for()
    at(page, "tab-diagnosis").click()
    page.locator(".q-tab-panel:visible td", has_text="▸").first.wait_for()
    page.keyboard.press("l")
    at(page, "phase", has_text="reached").wait_for()


def test_what_is_chosen_in_one_view_is_marked_in_every_other_one(
    open_page: Open, site: str
) -> None:
    page = open_page(f"{site}/run/monday")
    at(page, "phase", has_text="reached").wait_for()
    page.keyboard.press("f")
    at(page, "choose").fill("probe_1")
    page.keyboard.press("Enter")
    at(page, "panel", has_text="goal: stored(probe_1)").wait_for()
    page.locator(".bar.chosen").first.wait_for()
    marked = 'td:has-text("▸")'
    marks = {"plan": '[data-chosen="yes"]', "states": '[data-chosen="yes"]'}
    for name in ("plan", "world", "states", "diagnosis", "objects", "log"):
        at(page, f"tab-{name}").click()
        page.locator(f".q-tab-panel:visible {marks.get(name, marked)}").first.wait_for()
    at(page, "unchoose").click()
    at(page, "panel").wait_for(state="hidden")
    at(page, "tab-plan").click()
    step = page.locator('.q-tab-panel:visible .step[data-step^="put"]').first
    step.focus()
    page.keyboard.press("Enter")  # without a mouse
    at(page, "because").first.wait_for()
    page.keyboard.press("Escape")
    at(page, "panel").wait_for(state="hidden")


def test_the_net_of_contact_states_is_marked_as_the_run_stands(
    open_page: Open, site: str, store: Path
) -> None:
    follower = RunFollower(str(store), "tuesday")
    follower.refresh()
    picked = next(
        each for each in follower.done(0, len(follower.records)) if "pick(" in each["action"]
    )
    page = open_page(f"{site}/run/tuesday")
    page.keyboard.press("5")
    held = at(page, "inside").locator(
        "tbody tr", has=page.locator("td:first-child", has_text="mars_gripper")
    )
    held.get_by_text("P1", exact=True).wait_for()  # free
    page.evaluate(f"emitEvent('go', {picked['number']})")
    taken = picked["action"].partition("(")[2].partition(",")[0]
    held.get_by_text(taken).wait_for()
    place = held.locator("td").nth(1).inner_text()
    assert at(page, "net").locator(f'[data-place="{place}"] text').text_content().startswith("●")


def test_results_are_saved_as_qif_from_the_page(open_page: Open, site: str) -> None:
    page = open_page(f"{site}/run/monday")
    at(page, "tab-results").click()
    with page.expect_download() as saved:
        at(page, "save-qif").click()
    assert saved.value.suggested_filename == "monday.qif"
    assert "QIFDocument" in Path(saved.value.path()).read_text()


def test_it_plays_forwards_to_the_end_and_stands(open_page: Open, site: str) -> None:
    page = open_page(f"{site}/run/tuesday")
    at(page, "phase", has_text="reached").wait_for()
    page.keyboard.press("Home")
    at(page, "clock", has_text="0 records").wait_for()
    at(page, "play").click()
    at(page, "phase", has_text="running").wait_for()
    at(page, "play").click()


def test_two_runs_are_compared_and_the_first_difference_is_marked(
    open_page: Open, site: str, store: Path
) -> None:
    page = open_page(f"{site}/run/monday")
    at(page, "tab-compare").click()
    at(page, "other").click()
    page.locator(".q-menu .q-item", has_text="tuesday").click()
    at(page, "difference", has_text="the first difference is record").wait_for()
    assert page.locator("td", has_text="✗").first.inner_text().strip().startswith("✗")
    assert store.exists()


def test_the_arm_in_the_page_is_where_the_journal_puts_it(
    open_page: Open, site: str, store: Path
) -> None:
    follower = RunFollower(str(store), "monday")
    follower.refresh()
    retracing = Retracing.of(problem_of(TARGET), cell_of(TARGET), geometry_backend())
    steps = [taken for each in follower.records if (taken := retracing.take(each)) is not None]
    resting = RestingCell(cell_of(TARGET))
    page = open_page(f"{site}/run/monday")
    at(page, "tab-cell").click()
    at(page, "motion", has_text="the arm rests").wait_for()
    names = [
        name
        for name in ("arm.hand", "mars_gripper", "lid", "drawer")
        if name in resting.home.cell.bodies
    ]
    for taken in (steps[0], steps[2]):
        page.evaluate(f"emitEvent('go', {taken.number})")
        at(page, "motion", has_text=": 0 %").wait_for()
        page.wait_for_timeout(1000)
        shown = json.loads(at(page, "scene").get_attribute("data-poses"))
        wanted = body_poses(world_during(resting, taken, 0.0), names)
        for name in names:
            found = np.array(shown[name]).reshape(4, 4).T
            assert found == pytest.approx(wanted[name], abs=1e-5), name


def test_orders_cannot_be_given_to_a_run_that_is_over(open_page: Open, site: str) -> None:
    page = open_page(f"{site}/run/monday")
    at(page, "phase", has_text="reached").wait_for()
    for name in ("interrupt", "continue", "stop", "retry", "approve"):
        assert at(page, name).is_disabled()


def test_names_are_never_executed(open_page: Open, serve: Serve, tmp_path: Path) -> None:
    bad = "<img src=x onerror=window.hit=1>"
    store = tmp_path / "runs.db"
    plan = {
        "why": bad, "forecast_ms": 9, "goals": [bad], "given_up": [[bad, bad]], "order": [1], "dwells": [], "timed": False,
        "steps": [{"id": 1, "step": 'heat("<img src=x '
        'onerror=window.hit=1>")', "stream": bad, "says": bad, "lasts_ms": 5, "adds": ['hot("</svg><script>window.hit=1</script>")']}],
    }  # fmt: skip
    command = {
        "command": 1,
        "command_kind": "ask",
        "stream": bad,
        "action": bad,
        "says": bad,
        "choices": [bad],
        "asks": True,
        "lasts_ms": 5,
        "step": None,
    }
    failed = {"exception": bad, "step": 1, "action": bad, "reply": bad, "command": 1, "known": True}
    found = {
        "exception": bad,
        "action": bad,
        "outcome": bad,
        "belief": [[bad, 0.5]],
        "expected_cost": 1.0,
    }
    value = {
        "command": 1,
        "action": bad,
        "result": bad,
        "of": bad,
        "quantity": bad,
        "value": 1.0,
        "unit": bad,
    }
    world = {"why": bad, "adds": [bad], "ends": [], "reached": []}
    kinds = [("run", {}), ("plan", plan), ("command", command), ("exception", failed), ("finding", found), ("result", value), ("world", world)]  # fmt: skip
    with Journal(str(store)) as journal:
        journal.begin(bad, "2026-11-22", {"target": bad})
        journal.append(
            bad, [JournalLine(n, n, kind, content) for n, (kind, content) in enumerate(kinds, 1)]
        )
    page = open_page(f"{serve(store, tmp_path)}/")
    page.get_by_text(bad).first.click()
    at(page, "title", has_text="<img").wait_for()
    for name in (
        "plan",
        "cell",
        "world",
        "states",
        "sequence",
        "diagnosis",
        "results",
        "objects",
        "log",
        "compare",
        "now",
    ):
        at(page, f"tab-{name}").click()
        page.wait_for_timeout(300)
        for button in {"diagnosis": ["tree"]}.get(name, []):
            at(page, button).click()
            page.wait_for_timeout(3000)
    assert page.evaluate("window.hit") is None

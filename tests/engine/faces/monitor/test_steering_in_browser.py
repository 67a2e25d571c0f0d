"""Runs that go on are steered from pages: every button has its effect in the journal."""

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cellwright.engine.faces.monitor.run_follower import RunFollower, journal_record
from cellwright.engine.formats.interop.qif.feature_points import inspection_of
from cellwright.engine.model.run_protocol import RecordKind
from cellwright.kb.store.journal import Journal, JournalLine
from tests.engine.faces.monitor.conftest import Serve, approved, at, begun, started
from tests.engine.formats.interop.qif_parts import Document, plane, segment

Open = Callable[[str], Any]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("steering")


@pytest.fixture(scope="module")
def site(serve: Serve, folder: Path) -> str:
    with Journal(str(folder / "runs.db")) as journal:
        journal.begin("old", "2026-11-22", {})
    return serve(folder / "runs.db", folder)


def orders(store: Path, run: str, count: int) -> list[tuple[str, str, str]]:
    """The orders in the journal, once there are so many: what, what besides, and who."""
    found: list[tuple[str, str, str]] = []
    until = time.monotonic() + 60
    while len(found) < count and time.monotonic() < until:
        time.sleep(0.2)
        with Journal(str(store)) as journal:
            records = [journal_record(line) for line in journal.lines(run, 0)]
        given = [each.content for each in records if each.kind is RecordKind.ORDER]
        assert all(each["when"] for each in given)
        found = [(each["order"], each["given"], each["who"]) for each in given]
    return found


@pytest.mark.slow
def test_every_button_has_its_effect_in_the_journal(
    open_page: Open, site: str, folder: Path
) -> None:
    page = open_page(site)
    started(page, target="bulkhead/both_tools", name="buttons", factor="0.5")
    wanted = [("approve", "")]
    page.locator('[data-testid="interrupt"]:enabled').click()
    wanted.append(("interrupt", ""))
    at(page, "phase", has_text="paused").wait_for()
    for order, text in (("back", "99"), ("skip", "999"), ("correct", "hand_empty(nobody)")):
        at(page, "more").click()
        at(page, order).click()
        at(page, "text").fill(text)
        at(page, "give").click()
        wanted.append((order, text))
        assert [each[:2] for each in orders(folder / "runs.db", "buttons", len(wanted))] == wanted
        at(page, "phase", has_text="paused").wait_for()
    for order in ("retry", "stop"):
        page.locator(f'[data-testid="{order}"]:enabled').click()
        wanted.append((order, ""))
        found = orders(folder / "runs.db", "buttons", len(wanted))
    assert [each[:2] for each in found] == wanted
    assert {each[2] for each in found} == {"monitor"}


@pytest.mark.slow
def test_a_run_that_was_stopped_is_resumed_from_its_page(open_page: Open, site: str) -> None:
    page = open_page(site)
    started(page, target="themse/one", name="again", factor="0.01")
    at(page, "phase", has_text="running").wait_for()
    page.locator('[data-testid="stop"]:enabled').click()
    at(page, "phase", has_text="stopped").wait_for()
    at(page, "resume").click()
    at(page, "phase", has_text="reached").wait_for()


@pytest.mark.slow
def test_two_pages_at_once_show_the_same_and_either_may_steer(open_page: Open, site: str) -> None:
    one = open_page(site)
    begun(one, target="themse/in_furnace", name="shared", factor="0")
    other = open_page(f"{site}/run/shared")
    approved(other)
    for page in (one, other):
        at(page, "phase", has_text="reached").wait_for()
    clocks = [at(page, "clock").inner_text() for page in (one, other)]
    assert clocks[0] == clocks[1]


@pytest.mark.slow
def test_after_the_network_was_cut_no_event_is_lost_or_shown_twice(
    open_page: Open, site: str, folder: Path
) -> None:
    store = folder / "runs.db"
    with Journal(str(store)) as journal:
        journal.begin("cut", "2026-11-22", {})
        journal.append("cut", [JournalLine(n, n, "goal", {"goal": f"g({n})"}) for n in range(1, 4)])
        page = open_page(f"{site}/run/cut")
        at(page, "tab-log").click()
        page.locator("td", has_text="g(3)").first.wait_for()
        page.context.set_offline(True)
        for n in range(4, 40):
            journal.append("cut", [JournalLine(n, n, "goal", {"goal": f"g({n})"})])
            page.wait_for_timeout(50)
        page.context.set_offline(False)
        journal.append("cut", [JournalLine(40, 40, "goal", {"goal": "g(40)"})])
        page.locator("td", has_text="g(40)").first.wait_for()
        at(page, "tab-log").click()
        page.locator(".q-tab-panel:visible td", has_text="reached g(40)").wait_for()
    numbers = page.locator("tbody tr td:first-child").all_inner_texts()
    assert [each for each in numbers if each.isdigit()] == [str(n) for n in range(40, 0, -1)]
    follower = RunFollower(str(store), "cut")
    assert follower.refresh() == 40


@pytest.mark.slow
def test_a_point_that_is_picked_lands_in_the_problem_file(
    open_page: Open, site: str, folder: Path
) -> None:
    (folder / "job.yaml").write_text("problem: job\ndomain: bulkhead\ngoals: []\n")
    page = open_page(f"{site}/measure/job.yaml")
    page.get_by_role("button", name="left").click()
    page.wait_for_function("document.querySelector('[data-poses]')?.dataset.poses?.length > 100")
    page.wait_for_timeout(1500)
    box = page.locator('[data-testid="scene"] canvas').bounding_box()
    page.mouse.dblclick(box["x"] + 0.55 * box["width"], box["y"] + 0.45 * box["height"])
    at(page, "verdict", has_text="measured").wait_for()
    shown = [float(at(page, each).input_value()) for each in ("x", "y", "z")]
    at(page, "add").click()
    at(page, "points").get_by_text("p1").wait_for()
    found = re.search(
        r"position\(p1, (-?\d+), (-?\d+), (-?\d+)\)", (folder / "job.yaml").read_text()
    )
    assert found is not None
    assert [int(each) / 1000 for each in found.groups()] == pytest.approx(shown, abs=0.1)
    with page.expect_download() as saved:
        at(page, "qif").click()
    (point,) = inspection_of(Path(saved.value.path())).points
    assert [1000 * each for each in point.position] == pytest.approx(shown, abs=0.1)
    assert saved.value.suggested_filename == "job.qif"
    at(page, "undo").click()
    page.locator(".q-notification", has_text="undone").wait_for()
    assert "p1" not in (folder / "job.yaml").read_text()


@pytest.mark.slow
def test_measurements_are_edited_in_a_table_and_every_change_can_be_undone(
    open_page: Open, site: str, folder: Path
) -> None:
    path = folder / "sheet.yaml"
    path.write_text("problem: sheet\ndomain: bulkhead\ngoals: []\n")
    page = open_page(f"{site}/measure/sheet.yaml")
    for name, x in (("a1", "100"), ("a2", "150")):
        at(page, "name").fill(name)
        at(page, "x").fill(x)
        at(page, "nz").fill("-1")
        page.keyboard.press("Tab")
        at(page, "verdict", has_text="✓ can be measured by us_probe").wait_for()
        at(page, "add").click()
        at(page, "points").get_by_text(name, exact=True).wait_for()
    texts = [path.read_text()]
    page.get_by_label("tolerance of a1").fill("0.5")
    page.keyboard.press("Enter")
    texts.append(_changed(path, texts))
    assert "tolerance(a1, 500)" in texts[-1]
    for box in page.locator("tbody .q-checkbox").all():
        box.click()
    at(page, "tool").click()
    page.locator(".q-menu .q-item", has_text="slra").click()
    at(page, "verdict", has_text="not by slra, which cannot").wait_for()
    at(page, "change").click()
    page.locator(".q-notification", has_text="replaced: a1, a2").wait_for()
    texts.append(path.read_text())
    assert texts[-1].count("slra)") == 2
    for text in reversed(texts[:-1]):
        at(page, "undo").click()
        assert _changed(path, texts) == text
        texts.pop()


def _changed(path: Path, texts: list[str]) -> str:
    """The text of a file, once it is another one than the last of those that are known."""
    until = time.monotonic() + 60
    while path.read_text() == texts[-1] and time.monotonic() < until:
        time.sleep(0.1)
    return path.read_text()


@pytest.mark.slow
def test_it_is_told_why_a_point_cannot_be_reached_and_files_are_imported(
    open_page: Open, site: str, folder: Path
) -> None:
    document, corners = Document(), [(0, 0, 0), (50, 0, 0), (50, 50, 0), (0, 50, 0)]
    sides = zip(corners, [*corners[1:], corners[0]], strict=True)
    edges = [document.coedge(segment(a, b), (a, b))[0] for a, b in sides]
    document.feature("Plane", [document.face(plane(), [document.loop(edges)])])
    made = document.written(folder).with_suffix(".yaml")
    (folder / "points.csv").write_text("name,kind,x,y,z,nx,ny,nz\nb1,thickness,100,200,0,0,0,-1\n")
    page = open_page(f"{site}/measure")
    page.get_by_role("button", name=re.compile("Import .*qif")).click()
    page.get_by_role("link", name=made.name).wait_for()
    page.get_by_role("button", name="Import points.csv").click()
    page.get_by_role("link", name="points.yaml").click()
    at(page, "points").get_by_text("b1", exact=True).wait_for()
    for field, value in (("x", "100"), ("y", "200"), ("nz", "1")):
        at(page, field).fill(value)
    page.keyboard.press("Tab")
    at(
        page, "verdict", has_text=re.compile("✗ cannot be measured: .*not in this orientation")
    ).wait_for()

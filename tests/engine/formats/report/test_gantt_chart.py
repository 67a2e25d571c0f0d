"""Charts show every stage where it is, in letters and as SVG, and data say the same."""

import io
import xml.etree.ElementTree as ET

from rich.console import Console

from cellwright.engine.formats.report.plans.gantt_chart import (
    BarKind,
    GanttChart,
    gantt_rows,
    schedule_entry,
    schedule_summary,
    tightest_windows,
    window_rows,
)
from cellwright.engine.formats.report.plans.gantt_svg import draw_gantt
from cellwright.engine.model.shop_scheduling import (
    Hold,
    Resource,
    Schedule,
    Shop,
    ShopJob,
    ShopStage,
    StageMoment,
)
from cellwright.engine.model.window_breaches import WindowSpan
from cellwright.kb.model.plan_model import StepId
from cellwright.kb.model.time_windows import EventKind, EventPattern, Side, TimeWindow
from cellwright.kb.terms import Function
from tests.engine.stages.scheduling.test_checker import GOOD, SHOP


def drawn(width: int) -> list[str]:
    console = Console(width=width, color_system=None, record=True, file=io.StringIO())
    console.print(GanttChart(SHOP, GOOD, "s"))
    return console.export_text().splitlines()


def test_a_row_per_job_of_several_stages_and_per_unit_in_use() -> None:
    made = {
        row.name: [(bar.start, bar.end, bar.kind) for bar in row.bars]
        for row in gantt_rows(SHOP, GOOD)
    }
    assert made == {
        "a": [(3, 7, BarKind.STAGE), (9, 19, BarKind.STAGE)],
        "arm": [
            (1, 3, BarKind.CHANGE),
            (3, 7, BarKind.STAGE),
            (7, 9, BarKind.CHANGE),
            (11, 14, BarKind.STAGE),
        ],
        "oven": [(5, 19, BarKind.HOLD)],
    }


def test_units_of_a_resource_have_rows_of_their_own() -> None:
    jobs = tuple(
        ShopJob(name, (ShopStage(f"{name}0", 2), ShopStage(f"{name}1", 2))) for name in "ab"
    )
    holds = tuple(
        Hold("slot", StageMoment(f"{name}0"), StageMoment(f"{name}1", 2)) for name in "ab"
    )
    shop = Shop(jobs, (Resource("slot", 2, units=("left", "right")),), (), holds)
    made = gantt_rows(shop, Schedule({"a0": 0, "a1": 4, "b0": 1, "b1": 5}, (), 7, 0))
    assert [row.name for row in made] == ["a", "b", "left", "right"]


def test_the_chart_keeps_to_the_width_and_ends_with_a_scale() -> None:
    for width in (50, 80, 120):
        lines = drawn(width)
        assert max(map(len, lines)) <= width
        assert [line.split()[0] for line in lines] == ["a", "arm", "oven", "|0"]
        assert "bake" in lines[0]


def test_the_picture_is_xml_with_a_bar_for_everything() -> None:
    picture = draw_gantt(SHOP, GOOD, "s")
    assert picture == draw_gantt(SHOP, GOOD, "s")
    root = ET.fromstring(picture)
    titles = [each.text for each in root.iter("{http://www.w3.org/2000/svg}title")]
    assert "bake, 9 to 19" in titles
    assert "door: open, 1 to 3" in titles
    assert titles[0] == schedule_summary(GOOD, "s")
    bars = [
        each for each in root.iter("{http://www.w3.org/2000/svg}rect") if each.get("class") == "bar"
    ]
    assert len(bars) == sum(len(row.bars) for row in gantt_rows(SHOP, GOOD))


def test_steps_of_one_operator_have_one_colour_and_a_legend() -> None:
    steps = ("1 move(a, b)", "2 look(b)", "3 move(b, a)")
    shop = Shop(
        tuple(ShopJob(each, (ShopStage(each, 4, ("arm",)),)) for each in steps), (Resource("arm"),)
    )
    made = Schedule({each: 4 * n for n, each in enumerate(steps)}, (), 12, 12)
    root = ET.fromstring(draw_gantt(shop, made, "s"))
    bars = [
        each for each in root.iter("{http://www.w3.org/2000/svg}rect") if each.get("class") == "bar"
    ]
    first, look, last = sorted(bars, key=lambda each: float(each.get("x", 0)))
    assert first.get("fill") == last.get("fill") != look.get("fill")
    told = [each.text for each in root.iter("{http://www.w3.org/2000/svg}text")]
    assert told.count("move") == told.count("look") == 1


def test_data_say_when_each_stage_is() -> None:
    entry = schedule_entry(SHOP, GOOD)
    assert [(each["stage"], each["start"], each["end"]) for each in entry["stages"]] == [
        ("bring", 3, 7),
        ("bake", 9, 19),
        ("wipe", 11, 14),
    ]
    assert entry["changes"][0] == {
        "device": "door",
        "from": "shut",
        "to": "open",
        "start": 1,
        "end": 3,
    }
    assert (entry["makespan"], entry["lower_bound"], entry["gap"]) == (19, 19, 0.0)


def test_the_summary_says_what_is_known() -> None:
    open_one = Schedule({}, (), 100, 98, 3)
    assert (
        schedule_summary(open_one, "s")
        == "makespan 100 s, at least 98, gap 2.0 %, weighted tardiness 3"
    )
    assert schedule_summary(Schedule({}, (), 5, 5, 0, True)) == "makespan 5, proved to be the least"


def span(most: int | None, begin: int, end: int) -> WindowSpan:
    event = Function("read", (Function("a"),))
    one, other = (EventPattern(EventKind.EVENT, event, side) for side in (Side.END, Side.START))
    window = TimeWindow(one, other, most=most)
    steps = (StepId(1), StepId(2))
    return WindowSpan(window, "the end of x", "the start of y", begin, end, steps, (event, event))


def test_a_window_has_a_bar_up_to_its_latest_time() -> None:
    (row,) = window_rows([span(9, 3, 7)], 19, "s")
    (bar,) = row.bars
    assert (row.name, bar.start, bar.reached, bar.end) == ("at most 9", 3, 7, 12)
    assert "5 s slack" in bar.detail
    (open_ended,) = window_rows([span(None, 3, 7)], 19, "s")
    assert open_ended.bars[0].end == 7
    (cut,) = window_rows([span(90, 3, 7)], 19, "s")
    assert cut.bars[0].end == 19


def test_windows_are_drawn_in_both_charts_and_the_tightest_are_told() -> None:
    spans = (span(9, 3, 7), span(30, 4, 9))
    console = Console(width=60, color_system=None, record=True, file=io.StringIO())
    console.print(GanttChart(SHOP, GOOD, "s", spans))
    drawn_rows = console.export_text().splitlines()
    assert "─" in drawn_rows[3]
    assert "·" in drawn_rows[3]
    root = ET.fromstring(draw_gantt(SHOP, GOOD, "s", spans=spans))
    titles = [each.text or "" for each in root.iter("{http://www.w3.org/2000/svg}title")]
    assert sum("slack" in title for title in titles) == 2
    (told,) = tightest_windows(spans, "s")
    assert told.startswith("The windows with the least slack: 4 s from the end of x")
    assert tightest_windows([span(None, 1, 2)], "s") == []

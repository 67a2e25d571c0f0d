"""Windows of time and calendars as files say them."""

import json
from pathlib import Path

import pytest

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_problem
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.time_windows import EventKind, Side, TimeWindow

DOMAIN = """domain: lab
units: {time: UNIT}
types: {probe: object, basin: object}
objects: {basin: [b1, b2]}
statics:
  takes(probe, time): {}
fluents:
  clean(probe): {}
events:
  cut(probe, time): {}
operators:
  wash(Probe, Basin):
    types: {Probe: probe, Basin: basin}
    adds: clean(Probe)
    resources: Basin, Probe
    duration: 5 s
  slice(Probe, Time):
    where: takes(Probe, Time)
    preconditions: clean(Probe)
    adds: cut(Probe, Time)
    resources: saw, Probe
    duration: 10 s
  soil(Probe):
    preconditions: clean(Probe)
    deletes: clean(Probe)
    resources: Probe
    duration: 1 s
"""
PROBLEM = """problem: p
domain: lab
objects: {probe: [a, b, c]}
goals: [clean(a)]
"""


def loaded(folder: Path, said: str, unit: str = "s") -> Problem:
    text = DOMAIN.replace("UNIT", unit)
    (folder / "domain.yaml").write_text(text)
    (folder / "p.yaml").write_text(PROBLEM + said)
    return load_problem(folder / "p.yaml")


def window_of(folder: Path, line: str, unit: str = "s") -> TimeWindow:
    (window,) = loaded(folder, f'windows:\n  - "{line}"\n', unit).windows
    return window


@pytest.mark.parametrize(
    ("line", "limits"),
    [
        ("at most 10 min from clean(P) to cut(P)", (None, 600)),
        ("at least 5 min from clean(P) to cut(P)", (300, None)),
        ("exactly 60 min, up to 63 from clean(P) to cut(P)", (3600, 3780)),
        ("exactly 90 s from clean(P) to cut(P)", (90, 90)),
        ("at least 1 h 20 min, at most 1 h 30 min 5 s from clean(P) to cut(P)", (4800, 5405)),
        ("at least 1 min and at most 2 min from clean(P) to cut(P)", (60, 120)),
        ("at least 5, at most 0.5 min from clean(P) to cut(P)", (5, 30)),
    ],
)
def test_limits_have_units(tmp_path: Path, line: str, limits: tuple[int | None, ...]) -> None:
    window = window_of(tmp_path, line)
    assert (window.least, window.most) == limits


def test_the_unit_of_the_domain_counts(tmp_path: Path) -> None:
    assert window_of(tmp_path, "at most 2 s from clean(P) to cut(P)", "ms").most == 2000


def test_a_window_leads_from_an_end_to_a_start(tmp_path: Path) -> None:
    window = window_of(tmp_path, "at most 1 s from cut(P, _) to start of step wash(P)")
    assert (window.earlier.kind, window.earlier.side) == (EventKind.EVENT, Side.END)
    assert (window.later.kind, window.later.side) == (EventKind.STEP, Side.START)
    assert len(window.later.atom.arguments) == 2  # what is left out may be anything


def test_a_fact_begins_and_ends(tmp_path: Path) -> None:
    window = window_of(tmp_path, "at least 1 s from clean(P) to not clean(P)")
    assert (window.earlier.kind, window.earlier.side) == (EventKind.FACT, Side.END)
    assert (window.later.kind, window.later.side) == (EventKind.ENDING, Side.END)


def test_the_plan_has_a_start_and_an_end(tmp_path: Path) -> None:
    window = window_of(tmp_path, "at most 1 h from start of plan to end of plan")
    assert window.earlier.kind is window.later.kind is EventKind.PLAN


@pytest.mark.parametrize(
    "line",
    [
        "at most 10 min from clean(P) to cut(P)",
        "exactly 60 min, up to 63 from start of step wash(a, _) to not clean(a)",
        "at least 5 from start of plan to end of step slice(P, 10), price 3",
    ],
)
def test_a_window_is_read_back_as_it_is_written(tmp_path: Path, line: str) -> None:
    window = window_of(tmp_path, line)
    assert window_of(tmp_path, str(window)) == window


def test_a_window_may_be_about_some_objects_and_have_a_price(tmp_path: Path) -> None:
    said = """windows:
  - keep: at most 10 min from clean(P) to cut(P)
    for: {P: [a, b]}
    price: 2
"""
    (window,) = loaded(tmp_path, said).windows
    assert window.price == 2
    assert [len(values) for _, values in window.among] == [2]


def test_calendars_have_spans_that_come_again(tmp_path: Path) -> None:
    said = """calendars:
  - {of: saw, open: "8 h to 12 h, 12 h to 17 h", every: 24 h, begins: "7:30"}
  - {of: "wash(_, b1)", closed: 10 s to 20 s, starts: true}
"""
    day, closed = loaded(tmp_path, said).calendars
    assert day.spans == ((1800, 34200),)
    assert day.soonest(0, 60) == 1800
    assert day.soonest(34_150, 60) == 24 * 3600 + 1800
    assert closed.is_step
    assert closed.only_starts
    assert closed.soonest(10, 5) == 20
    assert closed.soonest(9, 5) == 9


@pytest.mark.parametrize(
    "entry",
    [
        "{of: saw, open: 8 h to 17 h, every: 24 h, begins: 7 h}",
        "{of: saw, closed: 1 h to 1 h 20 min}",
        "{of: saw, closed: 1 h to 2 h, every: 5 h}",
        "{of: 'wash(_, b1)', open: 2 h to 3 h, starts: true}",
    ],
)
def test_a_calendar_is_read_back_as_it_is_written(tmp_path: Path, entry: str) -> None:
    (calendar,) = loaded(tmp_path, f"calendars:\n  - {entry}\n").calendars
    written = json.dumps(calendar.entry())
    assert loaded(tmp_path, f"calendars:\n  - {written}\n").calendars == (calendar,)


def test_a_night_goes_on_the_next_day(tmp_path: Path) -> None:
    (night,) = loaded(
        tmp_path, "calendars: [{of: saw, open: 22 h to 6 h, every: 24 h}]\n"
    ).calendars
    assert night.soonest(0, 6 * 3600) == 0
    assert night.soonest(1, 6 * 3600) == 22 * 3600
    assert night.soonest(1, 8 * 3600) == 22 * 3600
    assert night.soonest(1, 9 * 3600) is None


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("at most 10 min from clean(P)", "K107"),
        ("soon from clean(P) to cut(P)", "K107"),
        ("at most 10 parsec from clean(P) to cut(P)", "K107"),
        ("at most 1 h 10 parsec from clean(P) to cut(P)", "K107"),
        ("at most 10 min from claen(P) to cut(P)", "K101"),
        ("at most 10 min from clean(P, Q) to cut(P)", "K102"),
        ("at least 10 min at most 9 min from clean(P) to cut(P)", "K321"),
        ("at most 10 min from clean(b1) to cut(P)", "K103"),
    ],
)
def test_what_is_wrong_is_told_at_its_line(tmp_path: Path, line: str, code: str) -> None:
    with pytest.raises(InvalidInput) as wrong:
        window_of(tmp_path, line)
    assert [d.code for d in wrong.value.diagnostics if not d.warning] == [code]
    assert wrong.value.diagnostics[0].where.line == 6

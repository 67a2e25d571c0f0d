import functools
import io
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console, RenderableType

from cellwright.engine.formats.report.plans import outcome_tables
from cellwright.engine.formats.report.text_tables import wrap_text
from cellwright.engine.model.answer_wording import step_purposes
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.plan_times import earliest_starts, object_histories, plan_makespan
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.loader import load_problem
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Text


@functools.cache
def planned(target: str) -> tuple[Problem, Plan]:
    problem = load_problem(target)
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    return problem, outcome.plan


def printed(target: str, width: int) -> str:
    problem, plan = planned(target)
    return shown(outcome_tables.outcome_text(Found(plan), problem), width)


def shown(made: RenderableType, width: int) -> str:
    stream = io.StringIO()
    Console(file=stream, width=width, color_system=None).print(made)
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


ONE_POINT = """\
step  after  start (s)  lasts  operator, and what it achieves
   1                 0      2  move_retract(t3_746, m1)
                                 at(t3_746, approach_point(meas(m1))) for 2
   2  1              2      2  move(t3_746, meas(m1), meas(m2))
                                 at(t3_746, approach_point(meas(m2))) for 3, 4
   3  2              4      3  apply_couplant(t3_746, m2)
                                 couplant_applied(goal_point(meas(m2))) for 5
   4  3              7      2  move_contact(t3_746, m2)
                                 at(t3_746, in_contact_point(meas(m2))) for 5
   5  4              9      4  us_measure(us_probe, t3_746, m2)
                                 measured(us_probe, t3_746, meas(m2)) for goal
5 steps, cost 5, 13 s if every step starts as early as possible
"""


def test_a_plan_is_a_table_of_steps_with_what_they_are_for() -> None:
    assert printed("bulkhead/one_point", 100) == ONE_POINT


@pytest.mark.slow
def test_no_internal_name_is_ever_shown() -> None:
    for target in ("themse/two", "bulkhead/twelve_points"):
        assert not re.search(r"\b_[a-z]", printed(target, 80))


@pytest.mark.parametrize("width", [80, 100, 200])
def test_no_line_is_longer_than_the_terminal_is_wide(width: int) -> None:
    assert max(map(len, printed("themse/two", width).splitlines())) <= width


@given(st.text("ab(,) _", max_size=60), st.integers(4, 40))
@settings(max_examples=200, deadline=None)
def test_wrapped_text_fits_and_is_whole(text: str, width: int) -> None:
    made = wrap_text(text, width)
    assert all(len(line) <= width for line in made.splitlines())
    assert "".join(made.split()) == "".join(text.split())


def test_atoms_break_after_commas_before_they_break_at_brackets() -> None:
    assert wrap_text("put(probe_1, slot(furnace, 1))", 20).splitlines() == [
        "put(probe_1,",
        "  slot(furnace, 1))",
    ]
    assert wrap_text("couplant_applied(goal_point(meas(m2)))", 24).splitlines() == [
        "couplant_applied(",
        "  goal_point(meas(m2)))",
    ]


def test_brackets_in_texts_are_no_markup() -> None:
    step = Step(StepId(1), Function("say", (Text("[bold]x[/bold]"),)), duration=1)
    assert "[bold]x[/bold]" in shown(
        outcome_tables.plan_table(Plan((step,)), load_problem("themse/one")), 80
    )


def test_colours_are_for_terminals_that_want_them(monkeypatch: pytest.MonkeyPatch) -> None:
    def colours(terminal: bool) -> set[str]:
        stream = io.StringIO()
        Console(file=stream, force_terminal=terminal, width=100).print(table)
        return set(re.findall(r"\x1b\[[0-9;]*3[0-7]m", stream.getvalue()))

    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    table = outcome_tables.plan_table(
        Plan((Step(StepId(1), Function("go")),)), load_problem("themse/one")
    )
    assert colours(True)
    assert not colours(False)
    monkeypatch.setenv("NO_COLOR", "1")
    assert not colours(True)


def test_an_empty_plan_says_so() -> None:
    assert shown(outcome_tables.plan_table(Plan(()), load_problem("themse/one")), 80).startswith(
        "Nothing to do"
    )


def test_a_narrow_terminal_loses_nothing() -> None:
    wide = "".join(printed("themse/one", 400).replace(";", "").split())
    for width in (70, 76, 80, 100):
        narrow = (
            printed("themse/one", width)
            .replace(";", "")
            .replace("operator, and what it achieves", "operatorachieves")
        )
        assert sorted(wide) == sorted("".join(narrow.split()))


@pytest.mark.parametrize("width", [76, 80, 100, 120])
@pytest.mark.parametrize("target", ["themse/two", "bulkhead/both_tools"])
def test_no_term_is_broken_where_it_fits_on_a_line(target: str, width: int) -> None:
    problem, plan = planned(target)
    reasons = step_purposes(problem, plan)
    shown = "\n".join(line.rstrip() for line in printed(target, width).splitlines())
    for step in plan.steps:
        assert all(term in shown for term in (str(step.operator), *reasons.get(step.id, ())))


def test_a_history_tells_what_is_done_how_long_and_in_which_order() -> None:
    problem, plan = planned("themse/two")
    for history in object_histories(problem, plan):
        assert [(each.stage.name, each.duration) for each in history.happenings][:2] == [
            ("heated", 900),
            ("cooled", 300),
        ]
        assert history.happenings[2].stage.name == "stored"
        starts = [each.start for each in history.happenings]
        assert starts == sorted(starts)


def test_every_step_starts_when_all_before_it_have_ended() -> None:
    _, plan = planned("themse/two")
    starts = earliest_starts(plan)
    steps = {step.id: step for step in plan.steps}
    for step in plan.steps:
        assert starts[step.id] == max(
            (starts[b] + steps[b].duration for b in step.after), default=0
        )
    assert plan_makespan(plan) == max(starts[step.id] + step.duration for step in plan.steps)

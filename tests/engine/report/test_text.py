import io

from rich.console import Console

from engine import pipeline
from engine.model.outcome import Found
from engine.model.schedule import earliest_starts, histories, makespan
from engine.report import text
from kb.loader import load_problem


def printed(target: str, width: int) -> str:
    problem = load_problem(target)
    outcome = pipeline.plan(problem)
    stream = io.StringIO()
    Console(file=stream, width=width, color_system=None).print(text.outcome(outcome, problem))
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


ONE_POINT = """\
step  operator                          after  start (s)  for  achieves
   1  move_retract(t3_746, m1)                         0    2  at(t3_746, approach_point(meas(m1))) for 2
   2  move(t3_746, meas(m1), meas(m2))  1              2    8  at(t3_746, approach_point(meas(m2))) for 3, 4
   3  apply_couplant(t3_746, m2)        2             10    3  couplant_applied(goal_point(meas(m2))) for 5
   4  move_contact(t3_746, m2)          3             13    2  at(t3_746, in_contact_point(meas(m2))) for 5
   5  us_measure(us_probe, t3_746, m2)  4             15    4  measured(us_probe, t3_746, meas(m2)) for goal
5 steps, cost 5, 19 s when every step starts as early as it may
"""


def test_a_plan_is_a_table_of_steps_with_what_they_are_for() -> None:
    assert printed("bulkhead/one_point", 120) == ONE_POINT


def test_no_internal_name_is_ever_shown() -> None:
    for target in ("themse/two", "bulkhead/twelve_points", "bulkhead/tool_missing"):
        assert " _" not in printed(target, 80)


def test_a_narrow_terminal_loses_nothing() -> None:
    wide = "".join(printed("themse/one", 300).split())
    assert sorted(wide) == sorted("".join(printed("themse/one", 80).split()))


def test_a_history_tells_what_is_done_how_long_and_in_which_order() -> None:
    problem = load_problem("themse/two")
    outcome = pipeline.plan(problem)
    assert isinstance(outcome, Found)
    for history in histories(problem, outcome.plan):
        assert [(each.stage.name, each.duration) for each in history.happenings][:2] == [
            ("heated", 900),
            ("cooled", 300),
        ]
        assert history.happenings[2].stage.name == "stored"
        starts = [each.start for each in history.happenings]
        assert starts == sorted(starts)


def test_every_step_starts_when_all_before_it_have_ended() -> None:
    outcome = pipeline.plan(load_problem("themse/two"))
    assert isinstance(outcome, Found)
    starts = earliest_starts(outcome.plan)
    steps = {step.id: step for step in outcome.plan.steps}
    for step in outcome.plan.steps:
        assert starts[step.id] == max((starts[b] + steps[b].duration for b in step.after), default=0)
    assert makespan(outcome.plan) == max(starts[step.id] + step.duration for step in outcome.plan.steps)

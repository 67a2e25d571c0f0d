"""Which window no plan keeps, the shortest time that is possible, and what needs it."""

from pathlib import Path

from rich.console import Console

from cellwright.engine.formats.report.plans.explanation_report import explanation_text
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.plan_explanation import Explanation
from cellwright.engine.pipelines.explanation import explain_infeasibility
from cellwright.engine.pipelines.planning.missed_windows import find_missed_windows
from cellwright.engine.pipelines.planning.plan_objective import plan_for_objective
from cellwright.engine.stages.grounding import ground
from cellwright.kb.loader import load_problem
from cellwright.kb.model.planning_problem import Problem

DOMAIN = """domain: lab
units: {time: s}
types: {plate: object, place: object}
objects: {place: [doser, reader, left, right]}
fluents: {"at(plate, place)": {}, "free(place)": {}}
events: {"stopped(plate)": {}, "readout(plate)": {}}
operators:
  stop(Plate):
    preconditions: at(Plate, doser)
    adds: stopped(Plate)
    resources: Plate, doser
    duration: 60 s
  carry(Plate, From, To):
    where: From != To
    preconditions: at(Plate, From), free(To)
    adds: at(Plate, To)
    resources: arm, Plate
    duration: 14 s
  read(Plate):
    preconditions: at(Plate, reader)
    adds: readout(Plate)
    resources: Plate, reader
    duration: 2 min
deductive_operators:
  - when: at(Plate, Place)
    denies: at(Plate, Other), Other != Place; free(Place)
  - when: not at(Plate, Place)
    implies: free(Place)
defaults: [free(Place)]
"""
PROBLEM = """problem: p
domain: lab
objects: {plate: [a, b]}
initial: ["at(a, left)", "at(b, right)"]
workflow:
  - for: {P: [a, b]}
    stages: stopped(P), readout(P)
windows:
"""


def problem_with(folder: Path, *windows: str) -> Problem:
    (folder / "domain.yaml").write_text(DOMAIN)
    (folder / "p.yaml").write_text(PROBLEM + "".join(f'  - "{line}"\n' for line in windows))
    return load_problem(folder / "p.yaml")


def explained(folder: Path, *windows: str) -> Explanation:
    return explain_infeasibility(problem_with(folder, *windows))


def test_the_shortest_possible_time_is_told_with_the_steps_that_need_it(tmp_path: Path) -> None:
    explanation = explained(tmp_path, "at most 10 s from stopped(P) to readout(P)")
    assert explanation.status == "infeasible"
    assert explanation.reason == (
        "no plan keeps this window: at most 10 s from the end of stopped(a) to the start of "
        "readout(a); the shortest possible is 14 s, because it takes carry(a, doser, reader) 14 s"
    )
    assert len(explanation.relaxed) == 1
    assert "4 s too long; and 1 more of this window" in explanation.relaxed[0]


def test_ends_of_steps_count(tmp_path: Path) -> None:
    line = "at most 3 min from start of stopped(P) to end of readout(P)"
    reason = explained(tmp_path, line).reason
    assert "the shortest possible is 194 s" in reason
    assert "stop(a) 60 s, then carry(a, doser, reader) 14 s, then read(a) 120 s" in reason


def test_a_deadline_of_the_plan_is_compared_with_what_all_plans_need(tmp_path: Path) -> None:
    reason = explained(tmp_path, "at most 3 min from start of plan to end of plan").reason
    assert "at most 180 s from the start of the plan to the end of the plan" in reason


def test_a_window_that_can_be_kept_is_not_in_the_way(tmp_path: Path) -> None:
    assert explained(tmp_path, "at most 14 s from stopped(P) to readout(P)").status == "feasible"


def test_a_plan_is_refused_for_the_same_reason(tmp_path: Path) -> None:
    problem = problem_with(tmp_path, "at most 10 s from stopped(P) to readout(P)")
    outcome = plan_for_objective(problem).outcome
    assert isinstance(outcome, Infeasible)
    assert outcome.reason == explain_infeasibility(problem).reason


def test_windows_that_exclude_one_another_are_told_as_not_kept(tmp_path: Path) -> None:
    windows = (
        "at most 20 s from stopped(a) to readout(a)",
        "at least 30 s from stopped(a) to readout(a)",
    )
    explanation = explained(tmp_path, *windows)
    assert explanation.status == "unknown"
    console = Console(width=200)
    with console.capture() as said:
        console.print(explanation_text(explanation))
    assert "no plan was found that keeps all times" in said.get()
    assert "that keeps all other windows and has" in said.get()


def test_check_warns_of_a_window_that_is_too_short_at_its_line(tmp_path: Path) -> None:
    problem = problem_with(
        tmp_path,
        "at most 14 s from stopped(P) to readout(P)",
        "at most 3 min from start of stopped(P) to end of readout(P)",
    )
    (warning,) = find_missed_windows(problem, ground(problem))
    assert (warning.code, warning.where.line) == ("K319", 10)
    assert "the shortest possible is 194 s" in warning.message

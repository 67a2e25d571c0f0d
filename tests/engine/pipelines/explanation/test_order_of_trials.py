"""In which order changes are tried, and which are not tried at all: what is plain comes first,
what bears on no goal never.
"""

from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Outcome
from cellwright.engine.model.plan_explanation import Edit
from cellwright.engine.pipelines.explanation import explain_infeasibility
from cellwright.engine.pipelines.explanation.candidate_edits import GoalBearing
from cellwright.engine.pipelines.explanation.helpful_changes import AlikeObjects, ChangeSearch
from cellwright.engine.pipelines.explanation.possible_facts import ProblemSpace
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.kb.asp.model_search import enumerate_models
from cellwright.kb.loader import load_problem
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number
from tests.engine.pipelines.explanation.test_explain import without_one_fact

LIDS = """
domain: lids
types: {item: object, probe: item, lid: item, place: object, depot: place}
objects: {lid: [cover], probe: [a], place: [rim, stand, shelf], depot: [slot]}
statics:
  fits(item, place): {}
  allowed(item, place): {}
fluents:
  at(item, place): {}
operators:
  put(Item, From, To):
    where: allowed(Item, To), From != To
    preconditions: at(Item, From)
    adds: at(Item, To)
    deletes: at(Item, From)
include: [rules.lp]
"""
RULES = """
fits(cover, (stand; shelf)).
fits(I, P) :- probe(I), depot(P).
allowed(I, P) :- fits(I, P).
"""
SHELVES = """
domain: shelves
types: {shelf: object, box: object, spot: object}
objects: {shelf: [left], box: [a, b, c, d]}
functions:
  hole(shelf, int): spot
statics:
  room(shelf, int): {}
  stays(box, int): {}
  width(shelf, int): {}
fluents:
  on(box, spot): {}
  seen(box): {}
operators:
  move(B, To):
    types: {B: box, To: spot}
    preconditions: not seen(B)
    adds: on(B, To)
  look(B, One, Other):
    types: {B: box, One: spot, Other: spot}
    where: room(left, 3), One != Other, B != a
    preconditions: on(B, One), not on(B, One)
    adds: seen(B)
  peek(B, One):
    types: {B: box, One: spot}
    where: width(left, 2), B != a
    preconditions: on(B, One), not on(B, One)
    adds: seen(B)
include: [rules.lp]
"""
BEADS = """
domain: beads
types: {bead: object, tray: object}
objects: {bead: [a, b, c], tray: [x, y]}
statics:
  box(bead, tray): {}
fluents:
  on(bead): {}
  done: {}
operators:
  finish(B):
    types: {B: bead}
    preconditions: on(B), not on(B)
    adds: done
include: [rules.lp]
"""
SPOTS = "spot(hole(S, 1..N)) :- room(S, N).\n"


def made(folder: Path, domain: str, rules: str, rest: str) -> Problem:
    """The problem of three texts."""
    (folder / "problems").mkdir()
    (folder / "domain.yaml").write_text(domain)
    (folder / "rules.lp").write_text(rules)
    name = domain.split()[1]
    (folder / "problems" / "p.yaml").write_text(f"problem: p\ndomain: {name}\n{rest}")
    return load_problem(str(folder / "problems" / "p.yaml"))


def space_of(problem: Problem) -> ProblemSpace:
    task = ground(problem)
    return ProblemSpace.of(problem, tuple(task.names(task.initial)))


def tried(problem: Problem) -> list[Problem]:
    """The changed problems that are planned with, in their order, where none of them helps."""
    found: list[Problem] = []

    def planned(each: Problem) -> Outcome | None:
        found.append(each)
        return None

    ChangeSearch(space_of(problem), problem, (), planned, lambda: False).smallest()
    return found


def test_a_fact_that_people_give_is_told_and_not_what_rules_alone_make_of_it(
    tmp_path: Path,
) -> None:
    problem = made(
        tmp_path, LIDS, RULES, "initial: ['at(cover, stand)']\ngoals: ['at(cover, rim)']\n"
    )
    assert [str(each) for each in explain_infeasibility(problem).changes] == [
        "add static fits(cover, rim)"
    ]


@pytest.mark.slow
def test_what_makes_a_problem_many_times_as_large_is_tried_after_all_else(tmp_path: Path) -> None:
    rest = "statics: ['room(left, 3)', 'stays(a, 400)', 'width(left, 1)']\ngoals: ['seen(b)']\n"
    of_one_kind = "held(B) :- stays(B, N), room(S, N).\n"
    problem = made(tmp_path, SHELVES, SPOTS + of_one_kind, rest)
    new = [set(each.statics) - set(problem.statics) for each in tried(problem)]
    single = [str(*facts) for facts in new if len(facts) == 1]
    assert {"room(left, 4)", "width(left, 2)"} <= set(single[: single.index("room(left, 400)")])


def test_of_changes_that_are_alike_but_for_names_one_is_tried(tmp_path: Path) -> None:
    problem = made(tmp_path, BEADS, "", "statics: ['box(a, x)', 'box(b, y)']\ngoals: ['done']\n")
    new = [sorted(map(str, set(each.initial) - set(problem.initial))) for each in tried(problem)]
    assert [facts for facts in new if len(facts) == 1] == [["on(a)"], ["on(c)"], ["done"]]


def test_what_belongs_to_alike_objects_changes_places_with_them(tmp_path: Path) -> None:
    problem = made(tmp_path, BEADS, "", "statics: ['box(a, x)', 'box(b, y)']\ngoals: ['done']\n")
    edit = Edit("static", Function("box", (Function("a"), Function("y"))))
    images = {str(each) for each in AlikeObjects(space_of(problem)).images(edit)}
    assert images == {"add static box(a, y)", "add static box(b, x)"}


def test_objects_that_an_operator_names_are_alike_with_none(tmp_path: Path) -> None:
    problem = made(tmp_path, SHELVES, SPOTS, "goals: ['seen(b)']\n")
    alike = AlikeObjects(space_of(problem))
    assert [
        sorted(map(str, alike.images(Edit("initial", Function("seen", (Function(each),))))))
        for each in ("a", "b", "c")
    ] == [
        ["add initial seen(a)"],
        ["add initial seen(b)"],
        ["add initial seen(c)", "add initial seen(d)"],
    ]


def test_no_fluent_is_tried_that_bears_on_no_goal() -> None:
    content = Function("content", (Function("tube_1"), Number(0)))
    at = Function("at", (Function("tube_2"), Function("seat_2")))
    whole = load_problem("centrifuge/four")
    spun = checked_plan.problem_of("centrifuge/four", command="spin tube 1 for 5 min")
    assert [GoalBearing(each).on_goals(content) for each in (whole, spun)] == [True, False]
    assert GoalBearing(spun).on_goals(at)


def test_a_fact_that_only_denies_a_default_bears_on_the_goals() -> None:
    elsewhere: Atom = Function("location", tuple(map(Function, ("slra", "t3_746", "elsewhere"))))
    assert GoalBearing(load_problem("bulkhead/tool_missing")).on_goals(elsewhere)


def test_models_read_the_terms_of_one_name_and_leave_the_others_as_texts() -> None:
    text = "1 { pick(1..2) } 1. shown(edit(X)) :- pick(X). shown(edited(X, f(X))) :- pick(X)."
    found = sorted(enumerate_models(text, "shown", "edit", 10), key=lambda each: str(each.terms))
    assert [(list(map(str, each.terms)), set(each.others)) for each in found] == [
        (["edit(1)"], {"edited(1,f(1))"}),
        (["edit(2)"], {"edited(2,f(2))"}),
    ]


@pytest.mark.slow
def test_the_rim_that_the_lid_of_the_freezer_fits_is_found_among_hundreds_of_facts() -> None:
    poorer = dict(without_one_fact(load_problem("themse/two")))["fits(lid,rim)."]
    assert [str(each) for each in explain_infeasibility(poorer).changes] == [
        "add static fits(lid, rim)"
    ]

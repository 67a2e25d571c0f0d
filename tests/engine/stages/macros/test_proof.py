"""Proofs of random plans: what was generalised gives the plan back, and each of its instances
passes the checker.
"""

import dataclasses
from collections.abc import Iterable

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from macro_cells import Example, constraints_hold, example
from macro_cells import posed as instance_of

from cellwright.engine.kernels.bits import bitset
from cellwright.engine.model.ground_task import progress_state
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.lifted.operator_schemas import NotGeneral
from cellwright.engine.stages.macros.lookup.macro_instances import instantiate_macro
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps, is_internal
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.plan_model import CausalLink, Macrop, Plan, Step
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Term, Variable, substitute_atom
from tests.engine.stages.validation.small_plans import link, step
from tests.engine.stages.validation.small_plans import problem as posed
from tests.properties.problems import CONSTANTS, problems
from tests.properties.random_plans import ATOMS

MANY = settings(max_examples=50, deadline=None, suppress_health_check=list(HealthCheck))


@st.composite
def planned(draw: st.DrawFn) -> tuple[Problem, Plan]:
    """A random executable sequence, deordered, with what it changes as its goal."""
    problem = draw(problems() | problems(deductive=True))
    try:
        task = ground(problem)
    except InvalidInput:
        assume(False)
    state, steps = task.initial, []
    own = [
        each for each in task.operators if not is_internal(each.instance) and not each.conditional
    ]
    for _ in range(draw(st.integers(1, 4))):
        following = [each for each in own if each.preconditions & ~state == 0]
        assume(following)
        steps.append(draw(st.sampled_from(following)))
        state = progress_state(state, steps[-1])
    changed = [a for a in task.names(state & ~task.initial) if a in ATOMS]
    gone = [a for a in task.names(task.initial & ~state) if a in ATOMS]
    assume(changed or gone)
    goal = And((*map(Literal, changed), *(Literal(atom, False) for atom in gone)))
    wanted = {*changed, *(Function("not", (atom,)) for atom in gone)}
    goals = bitset([number for number, atom in enumerate(task.atoms) if atom in wanted])
    return dataclasses.replace(problem, goal=goal), deorder_steps(task, steps, goals)


def learned(problem: Problem, plan: Plan) -> Example:
    """What is learned from a plan, if it is valid as it stands and can be generalised."""
    assume(validate_plan(problem, plan) == [])
    try:
        return example(problem, plan)
    except NotGeneral:
        assume(False)
        raise


@given(planned(), st.data())
@MANY
def test_every_instance_of_a_random_proof_passes_the_checker(
    case: tuple[Problem, Plan], data: st.DataObject
) -> None:
    found = learned(*case)
    macrop = found.learned.macrop
    own = found.learned.bindings
    assert constraints_hold(macrop, found.world, own)
    again = [
        (step.operator, step.after)
        for step in instantiate_macro(macrop, own, amounts_of(case[0])).steps
    ]
    assert again == [(step.operator, step.after) for step in found.plan.steps]
    changed: dict[Variable, Term] = {each: data.draw(st.sampled_from(CONSTANTS)) for each in own}
    assume(constraints_hold(macrop, found.world, changed))
    problem = instance_of(found, changed)
    assume(
        not any(
            substitute_atom(p.atom, changed) in problem.initial
            for p in macrop.preconditions
            if not p.positive
        )
    )
    assert validate_plan(problem, instantiate_macro(macrop, changed, amounts_of(problem))) == []


# What each proof demands, by example.

SHELF = """domain: shelf
types: {item: object, place: object, lamp: object}
objects: {item: [bolt, nut], place: [table, bin, rack], lamp: [red, green]}
statics: {"fits(item, place)": {}, "weight(item, int)": {}, "most(place, int)": {}}
derived: {busy(place): {}, "heavier(item, item)": {}, "above(item, item)": {}, alone(item): {}}
fluents: {"at(item, place)": {}, "over(item, item)": {}, lit(lamp): {}, dirty: {}, clean(item): {}, tried: {}}
include: [rules.lp]
operators:
  move(I, From, To):
    where: fits(I, To), From != To
    preconditions: at(I, From)
    adds: at(I, To)
    resources: arm
  store(I, P):
    where: weight(I, W), most(P, M), W <= M
    adds: at(I, P)
    resources: I
  swap(L, M): {adds: lit(L), deletes: lit(M)}
  light(L): {adds: lit(L)}
  douse(L): {deletes: lit(L)}
  look(L): {preconditions: lit(L), adds: tried}
  wipe(I): {preconditions: "at(I, table), not dirty", adds: clean(I)}
  pour(P): {preconditions: busy(P), adds: dirty}
  sweep(P): {preconditions: not busy(P), adds: tried}
  split(I, P, Q): {adds: "at(I, P), at(I, Q)"}
  bump(L): {types: {L: lamp}, adds: tried, effects: [{when: dirty, deletes: lit(L)}]}
  fill(P): {types: {P: place}, adds: tried, effects: [{when: "fits(bolt, P)", deletes: lit(red)}]}
  press(L): {types: {L: lamp}, effects: [{when: dirty, adds: lit(L)}, {when: tried, adds: lit(L)}]}
  note(I, J): {preconditions: "above(I, J) | tried", adds: clean(I)}
  stack(I, J): {adds: "over(I, J)"}
  turn(I, J, M, K): {where: J != K, preconditions: "over(I, J)", adds: tried, deletes: "over(M, K)"}
  free(I): {preconditions: alone(I), adds: tried}
deductive_operators:
  - {when: "at(I, P)", denies: "at(I, Q), Q != P"}
"""
RULES = """heavier(I, J) :- at(I, P), at(J, P), weight(I, V), weight(J, W), V > W.
busy(P) :- at(I, P), clean(I).
above(I, J) :- over(I, J).
above(I, K) :- above(I, J), over(J, K).
alone(I) :- item(I), not over(_, I).
"""
STATICS = (
    "fits(bolt, bin)",
    "fits(bolt, rack)",
    "fits(nut, bin)",
    "weight(bolt, 3)",
    "weight(nut, 9)",
    "most(rack, 5)",
)


def macrop(
    goals: str, initial: tuple[str, ...], steps: tuple[Step, ...], *links: CausalLink
) -> Macrop:
    """What is learned from a plan, which is valid."""
    found = posed(goals, initial, SHELF, statics=STATICS, rules=RULES)
    plan = Plan(steps, links)
    assert validate_plan(found, plan) == []
    return example(found, plan).learned.macrop


def texts(parts: Iterable[object]) -> set[str]:
    return {str(part) for part in parts}


ARM = ("arm",)
MOVE = step(1, "move(bolt, table, bin)", holds=ARM)
WIPE, POUR = step(1, "wipe(bolt)"), step(2, "pour(table)", 1)


@pytest.mark.parametrize(
    ("goals", "initial", "steps", "preconditions", "constraints", "apart", "adders"),
    [
        pytest.param(
            "at(bolt, bin)", "at(bolt, table)", (MOVE,),
            {"at(I1, From1)"}, {"fits(I1, To1)"}, {"From1 != To1"}, {"at(I1, To1)"},
            id="a step keeps its constraints",
        ),
        pytest.param(
            "at(bolt, "
            "rack)", "at(bolt, table)", (MOVE, step(2, "move(bolt, bin, rack)", 1, holds=ARM)),
            {"at(I1, "
            "From1)"}, {"fits(I1, "
            "To1)", "fits(I1, To2)"}, {"From1 != To1", "To1 != To2"}, {"at(I1, To2)"},
            id="a link makes what it joins equal, and the way may lead back",
        ),
        pytest.param(
            "at(bolt, bin), at(nut, bin)", "at(bolt, table); at(nut, table)",
            (MOVE, step(2, "move(nut, table, bin)", 1, holds=ARM)),
            {"at(I1, From1)", "at(I2, From2)"}, {"fits(I1, To1)", "fits(I2, To2)"},
            {"From1 != To1", "From2 != To2", "I1 != I2"}, {"at(I1, To1)", "at(I2, To2)"},
            id="what was the same by chance may differ, and what one step would undo of "
            "another may not be the same",
        ),
        pytest.param(
            "at(bolt, rack)", "at(bolt, table)", (step(1, "store(bolt, rack)", holds=("bolt",)),),
            set(), {"W <= M", "most(P1, M)", "weight(I1, W)"}, set(), {"at(I1, P1)"},
            id="numbers that constraints bind stay variables",
        ),
        pytest.param(
            "at(bolt, rack), at(nut, bin)", "at(bolt, table); at(nut, table)",
            (step(1, "store(bolt, "
            "rack)", holds=("bolt",)), step(2, "move(nut, table, bin)", holds=ARM)),
            {"at(I2, From1)"}, {"W <= M", "fits(I2, To1)", "most(P1, M)", "weight(I1, W)"},
            {"From1 != To1", "I1 != I2", "I1 != arm"}, {"at(I1, P1)", "at(I2, To1)"},
            id="unordered steps hold different resources",
        ),
        pytest.param(
            "tried, at(bolt, rack), at(nut, bin)", "at(bolt, table); at(nut, table)",
            (
                step(1, "light(red)"), step(2, "look(red)", 1),
                step(3, "store(bolt, "
                "rack)", holds=("bolt",)), step(4, "move(nut, table, bin)", holds=ARM),
            ),
            {"at(I2, From1)"}, {"W <= M", "fits(I2, To1)", "most(P1, M)", "weight(I1, W)"},
            {"From1 != "
            "To1", "I1 != I2", "I1 != arm"}, {"at(I1, P1)", "at(I2, To1)", "lit(L1)", "tried"},
            id="unordered steps hold different resources, whichever steps come before them",
        ),
        pytest.param(
            "at(bolt, rack), not at(bolt, table)", "at(bolt, table)",
            (step(1, "store(bolt, rack)", holds=("bolt",)),),
            set(), {"W <= M", "most(P1, M)", "weight(I1, W)"}, {"P1 != Value"}, {"at(I1, P1)"},
            id="what a step makes false by a rule it does under the conditions of this rule",
        ),
        pytest.param(
            "lit(red), not "
            "lit(green)", "lit(green)", (step(1, "light(red)"), step(2, "douse(green)")),
            set(), set(), {"L1 != L2"}, {"lit(L1)"},
            id="unordered steps do not undo each other",
        ),
        pytest.param(
            "lit(red), not "
            "lit(green)", "lit(green)", (step(1, "douse(green)"), step(2, "light(red)", 1)),
            set(), set(), {"L1 != L2"}, {"lit(L2)"},
            id="what was made false is not made true later",
        ),
        pytest.param(
            "lit(red), not lit(green)", "lit(green)", (step(1, "swap(red, green)"),),
            set(), set(), {"L1 != M1"}, {"lit(L1)"},
            id="what a step makes false it does not add itself",
        ),
        pytest.param(
            "lit(red)", "", (step(1, "swap(red, green)"),),
            set(), set(), set(), {"lit(L1)"},
            id="what is added stays true whatever the step deletes",
        ),
        pytest.param(
            "tried, not lit(green)", "lit(green)",
            (step(1, "light(red)"), step(2, "look(red)", 1), step(3, "douse(green)")),
            set(), set(), {"L1 != L2"}, {"lit(L1)", "tried"},
            id="what a step needs is not ended by another that may come before it",
        ),
        pytest.param(
            "tried, not "
            "lit(red)", "", (step(1, "light(red)"), step(2, "look(red)", 1), step(3, "douse(red)", 2)),
            set(), set(), set(), {"tried"},
            id="what comes after the consumer is no threat",
        ),
        pytest.param(
            "dirty", "at(bolt, table)", (WIPE, POUR),
            {"at(I1, P1)", "at(I1, table)", "not dirty"}, set(), set(), {"clean(I1)", "dirty"},
            id="a derived condition rests on what its rule reads",
        ),
        pytest.param(
            "clean(bolt), at(nut, bin)", "at(bolt, table); at(nut, table)",
            (WIPE, step(2, "move(nut, table, bin)", holds=ARM)),
            {"at(I1, "
            "table)", "at(I2, "
            "From1)", "not dirty"}, {"fits(I2, To1)"}, {"From1 != To1", "I1 != I2"},
            {"at(I2, To1)", "clean(I1)"},
            id="what stays as it was is not ended beside the step that needs it",
        ),
        pytest.param(
            "lit(red)", "lit(red)", (step(1, "light(red)"),),
            set(), set(), set(), {"lit(L1)"},
            id="what held before is no goal",
        ),
        pytest.param(
            "at(bolt, bin)", "at(bolt, table)", (step(1, "split(bolt, bin, bin)"),),
            set(), set(), set(), {"at(I1, P1)"},
            id="what a step may not add together is the same",
        ),
        pytest.param(
            "lit(red), tried", "", (step(1, "light(red)"), step(2, "bump(red)", 1)),
            {"not dirty"}, set(), set(), {"lit(L1)", "tried"},
            id="an effect that would end a link needs to stay out",
        ),
        pytest.param(
            "lit(red), tried", "dirty", (step(1, "light(red)"), step(2, "bump(green)", 1)),
            set(), set(), {"L1 != L2"}, {"lit(L1)", "tried"},
            id="an effect that comes ends something else",
        ),
        pytest.param(
            "lit(red), tried", "", (step(1, "light(red)"), step(2, "fill(table)", 1)),
            set(), {"not fits(bolt, P1)"}, set(), {"lit(L1)", "tried"},
            id="what no static fact allows is not allowed later",
        ),
        pytest.param(
            "lit(red)", "tried", (step(1, "press(red)"),),
            {"tried"}, set(), set(), {"lit(L1)"},
            id="an effect rests on its own condition, not on another's",
        ),
        pytest.param(
            "clean(bolt)", "over(nut, nut); tried", (step(1, "note(bolt, nut)"),),
            {"tried"}, set(), set(), {"clean(I1)"},
            id="rules that lead back to themselves end",
        ),
        pytest.param(
            "over(bolt, nut), "
            "tried", "", (step(1, "stack(bolt, nut)"), step(2, "turn(bolt, nut, nut, bolt)", 1)),
            set(), set(), {"J1 != K1"}, {"over(I1, J1)", "tried"},
            id="what a constraint keeps apart is not kept apart again",
        ),
    ],
)  # fmt: skip
def test_a_macrop_demands_what_its_proof_rests_on_and_no_more(
    goals: str,
    initial: str,
    steps: tuple[Step, ...],
    preconditions: set[str],
    constraints: set[str],
    apart: set[str],
    adders: set[str],
) -> None:
    found = macrop(goals, tuple(initial.split("; ")) if initial else (), steps)
    assert texts(found.preconditions) == preconditions
    assert texts(found.constraints) == constraints
    assert texts(found.disequalities) == apart
    assert texts(found.adders) == adders
    assert found.exclusions == ()


def test_the_goals_of_a_macrop_are_those_that_its_plan_achieves() -> None:
    assert texts(macrop("lit(red)", ("lit(red)",), (step(1, "light(red)"),)).goals) == set()
    both = macrop(
        "lit(red), not lit(green), not lit(green)", ("lit(green)",), (step(1, "swap(red, green)"),)
    )
    assert texts(both.goals) == {"lit(L1)", "not lit(M1)"}
    assert texts(macrop("lit(_)", (), (step(1, "light(red)"),)).goals) == {"lit(L1)"}


def test_links_say_which_step_provides_what() -> None:
    found = macrop("dirty", ("at(bolt, table)",), (WIPE, POUR))
    assert [f"{each.producer} {each.condition} {each.consumer}" for each in found.links] == [
        "0 at(I1, table) 1",
        "0 not(dirty) 1",
        "0 at(I1, P1) 2",
        "1 clean(I1) 2",
        "2 dirty -1",
    ]


def test_links_of_the_plan_decide_who_provides_a_condition() -> None:
    """Lit twice: without links the first step counts, since the lamp stays lit; a link may name
    the second.
    """
    steps = (step(1, "light(red)"), step(2, "light(red)", 1), step(3, "look(red)", 2))
    plain = macrop("tried", (), steps)
    told = macrop("tried", (), steps, link(2, "lit(red)", 3))
    assert "1 lit(L1) 3" in [
        f"{each.producer} {each.condition} {each.consumer}" for each in plain.links
    ]
    assert "2 lit(L2) 3" in [
        f"{each.producer} {each.condition} {each.consumer}" for each in told.links
    ]
    assert str(plain.steps[2].operator) == "look(L1)"
    assert str(told.steps[2].operator) == "look(L2)"


@pytest.mark.parametrize(("item", "number"), [("bolt", 1), ("nut", 2)])
def test_links_of_the_plan_decide_on_what_a_derived_condition_rests(item: str, number: int) -> None:
    """Both items make the table busy; the links say which of them counts."""
    steps = (step(1, "wipe(bolt)"), step(2, "wipe(nut)", 1), step(3, "pour(table)", 2))
    told = (link(0, f"at({item}, table)", 3), link(number, f"clean({item})", 3))
    found = macrop("dirty", ("at(bolt, table)", "at(nut, table)"), steps, *told)
    providers = [each.producer for each in found.links if each.consumer == 3]
    assert providers == [0, number]


def test_what_is_false_for_want_of_support_stays_as_it_was() -> None:
    """No rule makes the table busy, as the links say; so the constants stay."""
    told = (link(0, "at(bolt, table)", 1), link(0, "not(clean(bolt))", 1))
    found = macrop("tried", ("at(bolt, table)",), (step(1, "sweep(table)"),), *told)
    assert texts(found.preconditions) == {"at(bolt, table)", "not clean(bolt)"}
    assert str(found.steps[0].operator) == "sweep(table)"


def test_the_goals_of_a_goal_that_is_no_literal_are_what_its_links_provide() -> None:
    told = link(1, "not(at(bolt, table))", -1)
    found = macrop("not busy(table) | tried", ("at(bolt, table)", "clean(bolt)"), (MOVE,), told)
    assert texts(found.goals) == {"not at(bolt, table)"}


def refused(goals: str, steps: tuple[Step, ...], *initial: str) -> str:
    """Why a plan that is not valid is not generalised."""
    with pytest.raises(NotGeneral) as raised:
        example(posed(goals, initial, SHELF, statics=STATICS, rules=RULES), Plan(steps))
    return str(raised.value)


def test_a_plan_that_does_not_work_is_not_generalised() -> None:
    assert refused("lit(red)", ()) == "a plan without steps teaches nothing"
    assert "constraints of move(nut, table, rack)" in refused(
        "at(nut, rack)", (step(1, "move(nut, table, rack)", holds=ARM),), "at(nut, table)"
    )
    assert "precondition of look(red) does not hold" in refused("tried", (step(1, "look(red)"),))
    assert "is about all instances" in refused("tried", (step(1, "free(bolt)"),))


def test_a_condition_on_all_objects_is_not_generalised() -> None:
    house = """domain: house
types: {place: object}
objects: {place: [table]}
fluents: {"clean(place)": {}, tidy: {}}
operators:
  tidy_up: {preconditions: "clean(P) : place(P)", adds: tidy}
"""
    with pytest.raises(NotGeneral, match="a condition of tidy_up is about all objects"):
        example(posed("tidy", ("clean(table)",), house), Plan((step(1, "tidy_up"),)))


def test_a_plan_that_another_order_breaks_is_not_generalised() -> None:
    steps = (step(1, "bump(red)"), step(2, "light(red)"))
    assert "the original plan itself does not exclude this" in refused(
        "lit(red), tried", steps, "dirty"
    )

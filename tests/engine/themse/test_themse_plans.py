"""The THEMSE cell: its sentence, its problems, and that every door, lid and drawer step of its
plans is needed.
"""

import dataclasses
import random

import pytest
from themse_cell import Cell

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.validation import validate_plan
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.asp import ground_term
from cellwright.kb.asp.static_program import VIOLATED
from cellwright.kb.commands import understand_command
from cellwright.kb.loader import load_domain, load_problem
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function

SENTENCE = (
    "process {} in the furnace for 15 min, cool them down in the freezer for 5 min "
    "and store them in the drawer again"
)
DOORS = ("open_drawer", "close_drawer", "press_switch", "turn_bayonet")
PROCESSED = [("heated", 900), ("cooled", 300)]
SOLVABLE = ["one", "two", "four", "sentence", "in_furnace", "lid_on_stand", "furnace_of_two"]


def commanded(sentence: str) -> Problem:
    return understand_command(load_domain("themse"), sentence)


def planned(problem: Problem) -> Plan:
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    return outcome.plan


def home(probe: str) -> str:
    return f"slot(drawer, {probe[-1]})"


@pytest.mark.parametrize(
    ("said", "probes"),
    [
        ("probes 1 and 2", ["probe_1", "probe_2"]),
        pytest.param("all probes", [f"probe_{n}" for n in range(1, 5)], marks=pytest.mark.slow),
    ],
)
def test_the_sentence_heats_cools_and_stores(said: str, probes: list[str]) -> None:
    problem = commanded(SENTENCE.format(said))
    plan = planned(problem)
    assert validate_plan(problem, plan) == []
    cell = Cell().execute(plan)
    assert cell.history == dict.fromkeys(probes, PROCESSED)
    assert all(cell.where[probe] == home(probe) for probe in cell.where if probe != "lid")


@pytest.mark.parametrize("name", ["one", "two", pytest.param("four", marks=pytest.mark.slow)])
def test_the_plain_cell_executes_the_plans(name: str) -> None:
    plan = planned(load_problem(f"themse/{name}"))
    assert set(map(tuple, Cell().execute(plan).history.values())) == {tuple(PROCESSED)}


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in range(1, 5))]
)
def test_the_plain_cell_executes_a_plan_in_any_order_that_it_allows(seed: int) -> None:
    plan = planned(load_problem("themse/two"))
    shuffled = linearised(plan, random.Random(seed))
    assert Cell().execute(shuffled).history == dict.fromkeys(["probe_1", "probe_2"], PROCESSED)


def linearised(plan: Plan, chance: random.Random) -> Plan:
    done: list[Step] = []
    waiting = list(plan.steps)
    while waiting:
        ready = [step for step in waiting if not set(step.after) & {other.id for other in waiting}]
        done.append(chance.choice(ready))
        waiting.remove(done[-1])
    return dataclasses.replace(plan, steps=tuple(done))


def without(plan: Plan, removed: Step) -> Plan:
    """The plan without a step; what waited for it waits for what it waited for."""
    steps = [
        dataclasses.replace(step, after=bridged(step.after, removed))
        for step in plan.steps
        if step.id != removed.id
    ]
    links = [link for link in plan.links if removed.id not in (link.producer, link.consumer)]
    return Plan(tuple(steps), tuple(links))


def bridged(after: tuple[StepId, ...], removed: Step) -> tuple[StepId, ...]:
    if removed.id not in after:
        return after
    return tuple(dict.fromkeys(each for each in (*after, *removed.after) if each != removed.id))


def works_a_door(step: Step) -> bool:
    moves_the_lid = (
        step.operator.name in ("pick", "put") and Function("lid") in step.operator.arguments
    )
    return step.operator.name in DOORS or moves_the_lid


@pytest.mark.slow
@pytest.mark.parametrize("name", SOLVABLE)
def test_no_door_lid_or_drawer_step_can_be_left_out(name: str) -> None:
    problem = load_problem(f"themse/{name}")
    plan = planned(problem)
    doors = [step for step in plan.steps if works_a_door(step)]
    assert doors
    for step in doors:
        codes = {found.code for found in validate_plan(problem, without(plan, step))}
        assert codes & {"K501", "K502", "K506"}, f"{step.operator} is not needed"


def test_the_robot_is_free_while_a_probe_is_heated_or_cooled() -> None:
    plan = planned(commanded("heat probe 1 for 15 min and check the slippage"))
    before = plan.predecessors()
    heat, sense = (
        next(s for s in plan.steps if s.operator.name == name) for name in ("heat", "sense")
    )
    assert heat.id not in before[sense.id]
    assert sense.id not in before[heat.id]
    processes = [
        s for s in planned(load_problem("themse/one")).steps if s.operator.name in ("heat", "cool")
    ]
    assert len(processes) == 2
    assert not any(Function("mars_gripper") in step.resources for step in processes)


def test_a_furnace_of_two_heats_both_at_once() -> None:
    plan = planned(load_problem("themse/furnace_of_two"))
    before = plan.predecessors()
    one, other = (step for step in plan.steps if step.operator.name == "heat")
    assert one.id not in before[other.id]
    assert {str(one.operator.arguments[1]), str(other.operator.arguments[1])} == {
        "slot(furnace, 1)",
        "slot(furnace, 2)",
    }


def test_a_freezer_of_two_makes_the_unsolvable_problem_solvable() -> None:
    problem = load_problem("themse/unsolvable")
    assert isinstance(checked_plan.plan_problem(problem), Infeasible)
    larger = dataclasses.replace(problem, statics=(fact("capacity(freezer, 2)"),))
    assert planned(larger).steps


def test_a_smaller_drawer_has_fewer_slots() -> None:
    problem = understand_command(with_statics("capacity(drawer, 3)"), "put probe 1 into depot 4")
    assert isinstance(checked_plan.plan_problem(problem), Infeasible)


def test_again_means_the_own_depot() -> None:
    swapped = with_statics(
        "own_depot(probe_1, slot(drawer, 2))", "own_depot(probe_2, slot(drawer, 1))"
    )
    plan = planned(
        understand_command(swapped, "heat probe 1 for 5 min and store it in the drawer again")
    )
    assert str(plan.steps[-1].operator) == "put(probe_1, slot(drawer, 2))"


def test_two_probes_with_one_own_depot_violate_a_constraint() -> None:
    sound = Semantics(with_statics()).statics
    assert not list(sound.named(VIOLATED))
    shared = Semantics(with_statics("own_depot(probe_1, slot(drawer, 2))")).statics
    assert list(shared.named(VIOLATED))


def test_a_probe_told_otherwise_goes_where_it_is_told() -> None:
    plan = planned(
        commanded(
            "heat probe 1 for 5 min, then put probe 2 into the freezer, then put probe 1 into "
            "depot 2"
        )
    )
    cell = Cell().execute(plan)
    assert cell.where["probe_1"] == "slot(drawer, 2)"
    assert cell.where["probe_2"] == "slot(freezer, 1)"


@pytest.mark.parametrize("name", ["one", "two", "four"])
def test_probes_are_in_their_depots_unless_a_problem_says_otherwise(name: str) -> None:
    assert load_problem(f"themse/{name}").initial == ()


@pytest.mark.parametrize(
    ("sentence", "steps"),
    [
        ("open the drawer", ["open_drawer"]),
        ("close the drawer", []),
        ("check the grip force", ["sense(grip_force)"]),
        ("take probe 2", ["open_drawer", "pick(probe_2, slot(drawer, 2))"]),
        (
            "open the drawer, then close the drawer, then read the laser",
            ["open_drawer", "close_drawer", "sense(distance)"],
        ),
        (
            "open the freezer",
            ["turn_bayonet(locked, unlocked)", "pick(lid, rim)", "put(lid, stand)"],
        ),
    ],
)
def test_single_acts(sentence: str, steps: list[str]) -> None:
    assert [str(step.operator) for step in planned(commanded(sentence)).steps] == steps


def test_what_was_opened_is_closed_at_the_end_and_opened_only_once() -> None:
    """The drawer is closed as soon as nothing more is needed of it: that it is closed costs
    nothing later.
    """
    plan = planned(commanded("open the drawer, then heat probe 1 for 5 min, then close the drawer"))
    names = [step.operator.name for step in plan.steps]
    assert names.index("open_drawer") < names.index("pick") < names.index("close_drawer")
    assert (names.count("open_drawer"), names.count("close_drawer")) == (1, 1)


def fact(text: str) -> Function:
    term = ground_term(text)
    assert isinstance(term, Function)
    return term


def with_statics(*facts: str) -> Problem:
    return Problem("told otherwise", load_domain("themse"), statics=tuple(map(fact, facts)))

"""What runs out is counted: never where a plan exists, exactly where steps only take, and with
words that name both numbers.
"""

import itertools
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.explanation import explain_infeasibility
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import shortage
from cellwright.engine.stages.planning.shortage import shortages
from cellwright.kb.loader import load_problem

DOMAIN = """domain: lab
types: {well: object, bottle: object}
objects: {bottle: [b1, b2, b3], well: [w1, w2, w3, w4]}
statics: {usable(bottle): {}}
fluents: {dosed(well): {}, rinsed(well): {}, tip_on: {}}
quantities:
  left(bottle): 0..1000000
  tips: 0..100
  waste: 0..WASTE
operators:
  dose(Well, Bottle):
    where: usable(Bottle)
    preconditions: tip_on, not dosed(Well)
    adds: dosed(Well)
    deletes: tip_on
    decrease: {left(Bottle): 30000}
    increase: {waste: 1}
  take_tip:
    preconditions: not tip_on
    adds: tip_on
    decrease: {tips: 1}
  rinse(Well):
    preconditions: dosed(Well)
    adds: rinsed(Well)
    increase: {waste: 10}
MORE"""
REFILL = """  refill(B1, B2):
    where: B1 != B2
    decrease: {left(B1): 10000}
    increase: {left(B2): 10000}
"""


def task_of(
    folder: Path,
    bottles: tuple[int, ...],
    wells: int,
    tips: int = 50,
    waste: int = 90,
    more: str = "",
) -> GroundTask:
    (folder / "domain.yaml").write_text(DOMAIN.replace("WASTE", str(waste)).replace("MORE", more))
    amounts = [
        f"left(b{number}, {amount})" for number, amount in enumerate((*bottles, 0, 0, 0)[:3], 1)
    ]
    usable = [f"usable(b{number})" for number, _ in enumerate(bottles, 1)]
    goals = [f"rinsed(w{number})" for number in range(1, wells + 1)]
    (folder / "p.yaml").write_text(
        f"problem: p\ndomain: domain.yaml\nstatics: [{', '.join(map(repr, usable))}]\n"
        f"initial: [{', '.join(map(repr, (*amounts, f'tips({tips})', 'waste(0)')))}]\n"
        f"goals: [{', '.join(map(repr, goals))}]\n"
    )
    return ground(load_problem(str(folder / "p.yaml")))


@pytest.mark.parametrize(
    ("bottles", "wells", "tips", "waste", "more", "said"),
    [
        ((100_000,), 4, 9, 90, "", "the goals need 120,000 of left(b1), and there are 100,000"),
        ((120_000,), 4, 9, 90, "", ""),
        (
            (50_000, 50_000),
            3,
            9,
            90,
            "",
            "the goals need 90,000 of left(b1) and left(b2) together, and there are 100,000, of "
            "which 60,000 can be used",
        ),
        ((50_000, 40_000), 2, 9, 90, "", ""),
        ((90_000, 90_000), 4, 3, 90, "", "the goals need 4 of tips, and there are 3"),
        (
            (900_000,),
            4,
            9,
            40,
            "",
            "the goals need room for 44 more in waste, and there is room for 40",
        ),
        ((50_000, 50_000), 3, 9, 90, REFILL, ""),
        (
            (50_000, 30_000),
            3,
            9,
            90,
            REFILL,
            "the goals need 90,000 of left(b1) and left(b2) and left(b3) together, and there "
            "are 80,000",
        ),
    ],
)
def test_what_is_short_is_said_with_both_numbers(
    tmp_path: Path,
    bottles: tuple[int, ...],
    wells: int,
    tips: int,
    waste: int,
    more: str,
    said: str,
) -> None:
    assert (
        "; ".join(map(str, shortages(task_of(tmp_path, bottles, wells, tips, waste, more)))) == said
    )


@settings(max_examples=15, deadline=None)
@given(
    st.lists(st.sampled_from([0, 30_000, 50_000, 60_000]), min_size=1, max_size=2),
    st.integers(1, 2),
    st.integers(1, 3),
    st.sampled_from([11, 22, 90]),
    st.sampled_from(["", REFILL]),
)
def test_nothing_is_short_exactly_where_a_search_finds_a_plan(
    tmp_path_factory: pytest.TempPathFactory,
    bottles: list[int],
    wells: int,
    tips: int,
    waste: int,
    more: str,
) -> None:
    """All steps only take here, and none does two goals' work, so what is counted decides; with
    refills it may overlook one.
    """
    folder = tmp_path_factory.mktemp("short")
    task = task_of(folder, tuple(bottles), wells, tips, waste, more)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shortage, "MAX_GOALS", 0)
        outcome = checked_plan.plan_problem(load_problem(str(folder / "p.yaml")))
    assert isinstance(outcome, Found | Infeasible)
    assert not (shortages(task) and isinstance(outcome, Found))
    if not more:
        assert bool(shortages(task)) == isinstance(outcome, Infeasible)


LARGE = """domain: large
types: {well: object, reagent: object}
objects: {reagent: [dye, stain]}
quantities: {left(reagent): 0..HIGH}
events:
  dosed(well, reagent, int): {}
operators:
  dose(Well, Reagent, N):
    preconditions: left(Reagent) >= 96 * N
    adds: dosed(Well, Reagent, N)
    decrease: {left(Reagent): 96 * N}
    duration: 5
"""


@pytest.mark.parametrize("high", [10**5, 10**6, 2 * 10**9])
def test_explain_names_the_amount_that_is_just_enough(tmp_path: Path, high: int) -> None:
    (tmp_path / "domain.yaml").write_text(LARGE.replace("HIGH", str(high)))
    wells = [f"w{number}" for number in range(1, 9)]
    (tmp_path / "p.yaml").write_text(
        f"problem: p\ndomain: domain.yaml\nobjects: {{well: [{', '.join(wells)}]}}\n"
        "initial: ['left(dye, 10000)', 'left(stain, 90000)']\n"
        f"workflow: [{{for: {{W: [{', '.join(wells)}]}}, stages: 'dosed(W, stain, 50), dosed(W, "
        f"dye, 50)'}}]\n"
    )
    problem = load_problem(str(tmp_path / "p.yaml"))
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Infeasible)
    assert outcome.reason == "the goals need 38,400 of left(dye), and there are 10,000"
    found = explain_infeasibility(problem)
    assert found.exclusions == ("the goals need 14,400 of left(dye), and there are 10,000",)
    assert [str(each) for each in found.changes if each.edits] == [
        "change initial left(dye, 38400) instead of left(dye, 10000)"
    ]


def test_a_number_is_the_nearest_that_helps_where_nothing_is_counted(tmp_path: Path) -> None:
    """The reserve that a step needs is not used up, so the search decides; halves find the
    least number.
    """
    text = LARGE.replace("HIGH", "100000").replace(
        "left(Reagent) >= 96 * N", "left(Reagent) >= 96 * N + 777"
    )
    (tmp_path / "domain.yaml").write_text(text)
    (tmp_path / "p.yaml").write_text(
        "problem: p\ndomain: domain.yaml\nobjects: {well: [w1, w2]}\n"
        "initial: ['left(dye, 700)', 'left(stain, 0)']\n"
        "workflow: [{for: {W: [w1, w2]}, stages: 'dosed(W, dye, 3)'}]\n"
    )
    changes = explain_infeasibility(load_problem(str(tmp_path / "p.yaml"))).changes
    assert [str(each) for each in itertools.islice(changes, 1)] == [
        "change initial left(dye, 1353) instead of left(dye, 700)"
    ]


def test_explain_turns_no_thing_into_another_and_removes_no_scope(tmp_path: Path) -> None:
    (tmp_path / "domain.yaml").write_text(
        """domain: holes
types: {tool: object, laser: tool, sonar: tool, hole: object, plate: object}
objects: {laser: [l1], hole: [h1, h2], plate: [p1]}
statics:
  of(hole, plate): {}
  deep(hole): {}
  broken(tool): {}
fluents: {measured(hole): {}, done(plate): {}}
operators:
  look(Tool, Hole):
    types: {Tool: laser}
    where: not deep(Hole), not broken(Tool)
    adds: measured(Hole)
  hear(_Tool, Hole):
    types: {_Tool: sonar}
    where: deep(Hole)
    adds: measured(Hole)
  finish(Plate):
    preconditions: "measured(H) : of(H, Plate)"
    adds: done(Plate)
"""
    )
    (tmp_path / "p.yaml").write_text(
        "problem: p\ndomain: domain.yaml\nstatics: ['of(h1, p1)', 'of(h2, p1)', "
        "'deep(h2)']\ngoals: [done(p1)]\n"
    )
    changes = {
        str(each) for each in explain_infeasibility(load_problem(str(tmp_path / "p.yaml"))).changes
    }
    assert "add object sonar(sonar_1)" in changes
    assert not any("of(" in each or each.startswith("change object") for each in changes), changes


def test_goals_are_said_to_be_out_of_reach_together_only_if_each_can_be_reached(
    tmp_path: Path,
) -> None:
    text = (
        "domain: d\ntypes: {thing: object}\nobjects: {thing: [a, b]}\nfluents:\n  held(thing): "
        "{}\n  free: {}\n  lost: {}\n"
        "operators:\n  take(T): {preconditions: free, adds: held(T), deletes: free}\n"
        "  lose: {preconditions: lost, adds: lost}\n"
    )
    (tmp_path / "domain.yaml").write_text(text)
    reasons = []
    for goals in ("held(a), held(b)", "held(a), lost"):
        (tmp_path / "p.yaml").write_text(
            f"problem: p\ndomain: domain.yaml\ninitial: [free]\ngoals: ['{goals}']\n"
        )
        outcome = checked_plan.plan_problem(load_problem(str(tmp_path / "p.yaml")))
        assert isinstance(outcome, Infeasible)
        reasons.append(outcome.reason)
    assert "together" in reasons[0] or "every way" in reasons[0]
    assert "together" not in reasons[1]

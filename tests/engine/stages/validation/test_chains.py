"""Workflows along sequences: the checker agrees with every reading of the steps, tried one
after another.
"""

import dataclasses
import itertools
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.plan_model import Claims, Plan, Step
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.terms import Atom, join_stage
from tests.engine.stages.validation.small_plans import atom, link, problem, step, wrong

DOMAIN = """domain: bell
types: {thing: object, mark: object}
objects: {thing: [a, b], mark: [one, two]}
events: {rung(thing): {}}
fluents: {"up(thing, mark)": {}, "kept(thing)": {}}
operators:
  ring(T): {adds: rung(T)}
  ring_both: {adds: "rung(a), rung(b)"}
  ring_up(T, M): {adds: "rung(T), up(T, M)"}
  raise(T, M): {adds: "up(T, M)"}
  lower(T, M): {deletes: "up(T, M)"}
  keep(T): {adds: kept(T)}
  ring_keep(T): {adds: "rung(T), kept(T)"}
"""
DOES: dict[
    str, tuple[tuple[str, ...], tuple[str, ...]]
] = {  # the events of some steps, and the fluents they add
    "ring(a)": (("rung(a)",), ()),
    "ring(b)": (("rung(b)",), ()),
    "ring_both": (("rung(a)", "rung(b)"), ()),
    "ring_up(a, one)": (("rung(a)",), ("up(a, one)",)),
    "raise(a, one)": ((), ("up(a, one)",)),
    "raise(a, two)": ((), ("up(a, two)",)),
    "lower(a, one)": ((), ()),
    "keep(a)": ((), ("kept(a)",)),
    "keep(b)": ((), ("kept(b)",)),
    "ring_keep(a)": (("rung(a)",), ("kept(a)",)),
}
ENDS = {"lower(a, one)": "up(a, one)"}
# stages, and whether it comes after the chain before it
Chains = tuple[tuple[tuple[str, ...], bool], ...]
Reading = tuple[int, ...]
BOTH = "up(a, one) & up(a, two)"
BOTH_KEPT = "kept(a) & kept(b)"
STAGES = ("rung(a)", "rung(a)", "rung(b)", "up(a, one)", "up(a, two)", BOTH)
stage = st.sampled_from((*STAGES, "kept(a)", "kept(b)", BOTH_KEPT))
chains = st.lists(
    st.tuples(st.lists(stage, min_size=1, max_size=3).map(tuple), st.booleans()),
    min_size=1,
    max_size=3,
).map(tuple)


def readings(
    chains: Chains, steps: list[str], done: Reading, up: frozenset[str] = frozenset()
) -> Iterator[Reading]:
    """How far the chains may have come after some steps, each event being a stage of one chain;
    `up` is what holds.
    """
    if not steps:
        yield done
        return
    events, fluents = DOES[steps[0]]
    now = (up - {ENDS.get(steps[0], "")}) | set(fluents)
    for after in told(chains, events, done):
        reached = held(chains, after, now)
        if not too_early(chains, done, reached, up, now):
            yield from readings(chains, steps[1:], reached, now)


def too_early(
    chains: Chains, before: Reading, after: Reading, up: frozenset[str], now: frozenset[str]
) -> bool:
    """Whether a stage behind others has become true for ever with a step, and nothing of the
    step serves a stage now.
    """
    fresh = now - up
    served = {
        part
        for i, (m, n) in enumerate(zip(before, after, strict=True))
        for stage in (*chains[i][0][m:n], waits(chains, after, i))
        for part in stage.split(" & ")
    }
    for i, (stages, follows) in enumerate(chains):
        for stage in stages[0 if follows and i else 1 :]:
            parts = set(stage.split(" & "))
            if stage.startswith("kept") and parts & fresh - served and parts <= now:
                return True
    return False


def held(chains: Chains, done: Reading, up: frozenset[str]) -> Reading:
    """How far the chains are when all that hold have moved them, one after another."""
    for i in range(len(chains)):
        if (waited := waits(chains, done, i)) and up.issuperset(waited.split(" & ")):
            return held(chains, tuple(n + (i == j) for j, n in enumerate(done)), up)
    return done


def told(chains: Chains, events: tuple[str, ...], done: Reading) -> Iterator[Reading]:
    """How far the chains may have come after the events of one step, each moving another chain."""
    waiting = [waits(chains, done, i) for i in range(len(chains))]
    for own in itertools.permutations(range(len(chains)), len(events)):
        if all(waiting[i] == event for i, event in zip(own, events, strict=True)):
            yield tuple(n + (i in own) for i, n in enumerate(done))


def waits(chains: Chains, done: Reading, i: int) -> str:
    """The stage that a chain waits for; none while the chain before it, which it comes after,
    is not finished.
    """
    stages, follows = chains[i]
    blocked = follows and i > 0 and done[i] == 0 and done[i - 1] < len(chains[i - 1][0])
    return "" if blocked or done[i] == len(stages) else stages[done[i]]


def posed(chains: Chains) -> Problem:
    """The problem of these chains, each about something of its own."""
    made = [
        Chain(
            f"c{i}",
            tuple(map(read, stages)),
            (f"c{i - 1}",) if follows and i else (),
            atom(f"s{i}"),
        )
        for i, (stages, follows) in enumerate(chains)
    ]
    return dataclasses.replace(problem("", (), DOMAIN), chains=tuple(made))


def read(stage: str) -> Atom:
    """A stage of one atom or of several."""
    found = [atom(each) for each in stage.split(" & ")]
    return found[0] if len(found) == 1 else join_stage(found)


def sequence(*operators: str) -> tuple[Step, ...]:
    """The steps, one after another."""
    return tuple(step(n, each, *([n - 1] if n > 1 else [])) for n, each in enumerate(operators, 1))


@given(chains, st.lists(st.sampled_from(list(DOES)), max_size=5))
@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
def test_a_sequence_is_accepted_if_some_reading_of_it_finishes_every_chain(
    chains: Chains, steps: list[str]
) -> None:
    finished = tuple(len(stages) for stages, _ in chains)
    possible = finished in set(readings(chains, steps, tuple(0 for _ in chains)))
    found = wrong(posed(chains), sequence(*steps))
    lost = any("up(a, one)" in stages[-1] for stages, _ in chains) and not lasts(steps)
    assert (found == []) == (possible and not lost)
    assert all(each.startswith("K506") for each in found)


def lasts(steps: list[str]) -> bool:
    """Whether what the first thing is raised to still holds at the end."""
    found = [each for each in steps if each in ("raise(a, one)", "ring_up(a, one)", *ENDS)]
    return bool(found) and found[-1] not in ENDS


@pytest.mark.slow
@given(chains)
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
def test_planned_chains_have_the_fewest_steps_that_any_reading_needs(chains: Chains) -> None:
    """The planner, the checker and the readings tried one after another mean the same."""
    made = checked_plan.plan_problem(posed(chains))
    longest = len(made.plan.steps) - 1 if isinstance(made, Found) else 2
    shorter = (
        list(steps)
        for n in range(min(longest, 3) + 1)
        for steps in itertools.product(DOES, repeat=n)
    )
    assert not any(wrong(posed(chains), sequence(*steps)) == [] for steps in shorter)
    if isinstance(made, Found):
        assert validate_plan(posed(chains), made.plan) == []


def test_a_stage_that_held_before_its_turn_holds_in_every_order() -> None:
    """Nothing may end it between the step that made it true and the step after which its turn
    comes.
    """
    told = posed(((("rung(a)", "up(a, one)", "rung(b)"), False),))
    first = (step(1, "raise(a, one)"), step(2, "ring(a)", 1), step(3, "ring(b)", 2))
    assert wrong(told, first) == []
    assert wrong(told, (*first, step(4, "lower(a, one)", 2))) == []
    found = wrong(told, (*first, step(4, "lower(a, one)", 1)))
    assert found == [
        "K506: up(a, one) of c0 is reached when step 2 has come, but it may not hold then in "
        "every order"
    ]


@pytest.mark.parametrize(
    ("producer", "stage", "right"), [(2, 1, True), (2, 2, True), (1, 1, False), (3, 1, False)]
)
def test_a_stage_that_held_before_its_turn_is_reached_with_the_step_before_it(
    producer: int, stage: int, right: bool
) -> None:
    told = posed(((("rung(a)", "up(a, one)", "rung(b)"), False),))
    steps = (step(1, "raise(a, one)"), step(2, "ring(a)", 1), step(3, "ring(b)", 2))
    plan = Plan(steps, (link(producer, f'_stage("c0", {stage})', -1),))
    assert ([each.code for each in validate_plan(told, plan, claims=Claims())] == []) == right


def test_a_stage_that_holds_to_the_end_needs_no_order() -> None:
    told = posed(((("rung(a)",), False), (("up(a, one)",), True)))
    assert wrong(told, (step(1, "raise(a, one)"), step(2, "ring(a)"))) == []
    awaited = posed(((("rung(a)",), False), (("up(a, one)",), True), (("rung(b)",), True)))
    unordered = (step(1, "raise(a, one)"), step(2, "ring(a)"), step(3, "ring(b)", 2))
    assert wrong(awaited, unordered) != []
    assert (
        wrong(awaited, (step(1, "raise(a, one)"), step(2, "ring(a)", 1), step(3, "ring(b)", 2)))
        == []
    )


def test_what_stays_is_made_in_its_turn() -> None:
    """Otherwise its stage would be reached without any step, and the order of the chain would
    be lost.
    """
    told = posed(((("kept(a)", "rung(a)", "kept(b)"), False),))
    right = (step(1, "keep(a)"), step(2, "ring(a)", 1), step(3, "keep(b)", 2))
    assert wrong(told, right) == []
    early = (step(1, "keep(a)"), step(2, "keep(b)", 1), step(3, "ring(a)", 2))
    assert wrong(told, early) == [
        "K506: step 2 keep(b): kept(b) is not the next stage of any chain"
    ]
    assert wrong(told, (*right, step(4, "keep(b)"))) == [
        "K506: steps 3 and 4 must be ordered: kept(b) is reached in its turn"
    ]
    assert (
        wrong(told, (step(1, "keep(a)"), step(2, "ring_keep(a)", 1), step(3, "keep(b)", 2))) == []
    )


def test_what_stays_may_come_first_where_it_is_a_first_stage() -> None:
    told = posed(((("kept(a)", "rung(a)"), False), (("kept(a)",), True)))
    assert wrong(told, (step(1, "keep(a)"), step(2, "ring(a)", 1))) == []


def test_one_step_moves_several_chains() -> None:
    both = posed(((("rung(a)",), False), (("rung(b)",), False)))
    assert wrong(both, (step(1, "ring_both"),)) == []
    once = posed(((("rung(a)", "rung(b)"), False),))
    assert [each[:4] for each in wrong(once, (step(1, "ring_both"),))] == ["K506"]


def test_a_last_stage_that_needs_no_order_leaves_the_order_of_those_before_it() -> None:
    told = posed(((("rung(a)", "rung(b)", "up(a, one)"), False),))
    raised, rung = step(1, "raise(a, one)"), step(2, "ring(a)", 1)
    assert wrong(told, (raised, rung, step(3, "ring(b)", 2))) == []
    assert wrong(told, (raised, rung, step(3, "ring(b)", 1))) == [
        "K506: steps 2 and 3 must be ordered: they reach stages of c0"
    ]


def test_a_chain_that_comes_after_another_begins_after_its_end() -> None:
    told = posed(((("rung(a)",), False), (("rung(b)", "up(a, two)"), True)))
    last = step(3, "raise(a, two)", 1, 2)
    assert wrong(told, (step(1, "ring(a)"), step(2, "ring(b)", 1), last)) == []
    assert wrong(told, (step(1, "ring(a)"), step(2, "ring(b)"), last)) == [
        "K506: steps 1 and 2 must be ordered: c1 comes after c0"
    ]


def test_a_chain_waits_for_the_last_stage_of_the_one_before_it() -> None:
    told = posed(((("rung(a)", "rung(b)"), False), (("up(a, two)",), True)))
    both = step(1, "ring(a)"), step(2, "ring(b)", 1)
    assert wrong(told, (*both, step(3, "raise(a, two)", 2))) == []
    assert wrong(told, (*both, step(3, "raise(a, two)", 1))) != []


def test_what_is_reached_together_is_reached_when_all_of_it_holds() -> None:
    told = posed((((BOTH, "rung(a)"), False),))
    one, two = step(1, "raise(a, one)"), step(2, "raise(a, two)", 1)
    assert wrong(told, (one, two, step(3, "ring(a)", 2))) == []
    assert wrong(told, (one, step(2, "ring(a)", 1), step(3, "raise(a, two)", 2))) != []
    lowered = step(2, "lower(a, one)", 1), step(3, "raise(a, two)", 2), step(4, "ring(a)", 3)
    assert wrong(told, (one, *lowered)) != []
    assert wrong(posed((((BOTH,), False),)), (one, step(2, "raise(a, two)"))) == []

"""Workflows along sequences: the checker agrees with every reading of the steps, tried one after another."""

import dataclasses
import itertools
from collections.abc import Iterator

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kb.model.plan import Step
from kb.model.problem import Chain, Problem
from tests.engine.stages.validation.plans import atom, problem, step, wrong

DOMAIN = """domain: bell
types: {thing: object, mark: object}
objects: {thing: [a, b], mark: [one, two]}
events: {rung(thing): {}}
fluents: {"up(thing, mark)": {}, done: {}}
operators:
  ring(T): {adds: rung(T)}
  ring_both: {adds: "rung(a), rung(b)"}
  ring_up(T, M): {adds: "rung(T), up(T, M)"}
  raise(T, M): {adds: "up(T, M)"}
  lower(T, M): {deletes: "up(T, M)"}
"""
DOES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {  # the events and the fluents of some steps
    "ring(a)": (("rung(a)",), ()),
    "ring(b)": (("rung(b)",), ()),
    "ring_both": (("rung(a)", "rung(b)"), ()),
    "ring_up(a, one)": (("rung(a)",), ("up(a, one)",)),
    "raise(a, one)": ((), ("up(a, one)",)),
    "raise(a, two)": ((), ("up(a, two)",)),
}
Chains = tuple[tuple[tuple[str, ...], bool], ...]  # stages, and whether it comes after the chain before it
Reading = tuple[int, ...]
stage = st.sampled_from(("rung(a)", "rung(a)", "rung(b)", "up(a, one)", "up(a, two)"))
chains = st.lists(
    st.tuples(st.lists(stage, min_size=1, max_size=3).map(tuple), st.booleans()), min_size=1, max_size=3
).map(tuple)


def readings(chains: Chains, steps: list[str], done: Reading) -> Iterator[Reading]:
    """How far the chains may have come after some steps, each event being a stage of one chain."""
    if not steps:
        yield done
        return
    events, fluents = DOES[steps[0]]
    for after in told(chains, events, done):
        moved = tuple(
            n + (n == before and waits(chains, done, i) in fluents)
            for i, (before, n) in enumerate(zip(done, after, strict=True))
        )
        yield from readings(chains, steps[1:], moved)


def told(chains: Chains, events: tuple[str, ...], done: Reading) -> Iterator[Reading]:
    """How far the chains may have come by the events of one step: each moves another chain, by one stage."""
    for chosen in itertools.permutations(range(len(chains)), len(events)):
        if all(waits(chains, done, i) == event for i, event in zip(chosen, events, strict=True)):
            yield tuple(n + (i in chosen) for i, n in enumerate(done))


def waits(chains: Chains, done: Reading, i: int) -> str:
    """The stage that a chain waits for; none while the chain before it, which it comes after, is not finished."""
    stages, follows = chains[i]
    blocked = follows and i > 0 and done[i] == 0 and done[i - 1] < len(chains[i - 1][0])
    return "" if blocked or done[i] == len(stages) else stages[done[i]]


def posed(chains: Chains) -> Problem:
    """The problem of these chains, each about something of its own."""
    made = [
        Chain(f"c{i}", tuple(map(atom, stages)), (f"c{i - 1}",) if follows and i else (), atom(f"s{i}"))
        for i, (stages, follows) in enumerate(chains)
    ]
    return dataclasses.replace(problem("", (), DOMAIN), chains=tuple(made))


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
    assert (found == []) == possible
    assert all(each.startswith("K506") for each in found)


def test_of_two_events_that_no_chains_expect_together_the_first_is_named() -> None:
    assert wrong(posed(((("rung(b)",), False),)), sequence("ring_both")) == [
        "K506: step 1 ring_both: rung(a) is not the next stage of any chain"
    ]

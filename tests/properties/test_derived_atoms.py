"""Derived atoms that stay in the ground task, against brute force over the domain's own meaning."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from hypothesis import HealthCheck, assume, event, given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.interop.pddl import read_pddl_task
from cellwright.engine.formats.interop.pddl.export import pddl_text_of
from cellwright.engine.kernels.bits import bitset, indices
from cellwright.engine.model.ground_axioms import Axioms, GroundAxiom
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits, plan_task
from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_solving import solve_conditions
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.rule_derivation import RuleDerivation
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, substitute_atom
from tests.properties.problems import problems, shortest

FAMILIES = st.one_of(problems(), problems(conditional=True), problems(deductive=True))
DILIGENT = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))


@contextmanager
def layered() -> Iterator[None]:
    """No derived atom is replaced by its definition."""
    with (
        patch("cellwright.engine.stages.grounding.derived_atoms.MAX_SUPPORTS", 0),
        patch("cellwright.engine.stages.grounding.derived_atoms.MIN_SUPPORTS", 0),
    ):
        yield


def grounded(problem: Problem) -> GroundTask:
    try:
        with layered():
            return ground(problem)
    except InvalidInput:
        assume(False)
        raise


@given(FAMILIES, st.sampled_from(["auto", "forward", "landmarks"]))
@DILIGENT
def test_a_search_over_derived_atoms_agrees_with_brute_force(
    problem: Problem, strategy: str
) -> None:
    """The plan is also one for the checker, with causal links of fluents only: `planning.plan`
    has it checked.
    """
    try:
        with layered():
            outcome = checked_plan.plan_problem(problem, SearchLimits(strategy=strategy))
    except InvalidInput:
        assume(False)
    length = shortest(problem)
    event(type(outcome).__name__)
    assert isinstance(outcome, Infeasible if length is None else Found)


@given(FAMILIES)
@DILIGENT
def test_derived_atoms_are_true_where_the_checker_says_so(problem: Problem) -> None:
    task = grounded(problem)
    assume(task.axioms is not None)
    semantics = Semantics(problem)
    states, waiting = {task.initial}, [task.initial]
    while waiting and len(states) < 60:
        state = waiting.pop()
        following = (task.after(state, o) for o in task.operators if o.preconditions & ~state == 0)
        waiting += dict.fromkeys(each for each in following if each not in states)
        states.update(waiting)
    for state in states:
        fluents = [a for a in task.names(state) if a.name in semantics.problem.domain.predicates]
        facts = semantics.facts([a for a in fluents if a.name not in ("d", "e")])
        assert {a for a in fluents if a.name in ("d", "e")} <= {
            *facts.named("d"),
            *facts.named("e"),
        }
        missing = [a for a in task.atoms if a.name in ("d", "e") and a not in fluents]
        assert not any(a in facts for a in missing)


@given(problems())
@settings(DILIGENT, max_examples=20)
def test_strategies_that_need_definitions_say_so(problem: Problem) -> None:
    task = grounded(problem)
    assume(task.axioms is not None and task.goals)
    outcome = plan_task(task, SearchLimits(strategy="backward"))
    assert isinstance(outcome, GaveUp)
    assert "forward" in outcome.reason


@given(problems())
@settings(DILIGENT, max_examples=20)
def test_the_ground_export_keeps_the_rules(problem: Problem) -> None:
    text = pddl_text_of(problem, grounded(problem), lifted=False)
    with TemporaryDirectory() as folder:
        domain, task = Path(folder) / "domain.pddl", Path(folder) / "problem.pddl"
        domain.write_text(text.domain)
        task.write_text(text.problem)
        outcome = checked_plan.plan_problem(read_pddl_task(domain, task).problem)
    length = shortest(problem)
    assert isinstance(outcome, Infeasible if length is None else Found)


@st.composite
def axioms(draw: st.DrawFn) -> Axioms:
    """Four fluents with complements (0 to 7), five derived atoms with complements (8 to 17), in
    layers of one or two.
    """
    layers = {8: 0, 9: 0, 10: 1, 11: 2, 12: 2}
    complements = {**{n: n + 4 for n in range(4)}, **{n: n + 5 for n in layers}}
    rules = []
    for head, layer in layers.items():
        own = [n for n, other in layers.items() if other <= layer]
        below = [n + 5 for n, other in layers.items() if other < layer]
        body = st.sets(st.sampled_from([*range(8), *own, *below]), max_size=3)
        rules += [GroundAxiom(head, bitset(each)) for each in draw(st.lists(body, max_size=3))]
    return Axioms(18, tuple(rules), layers, complements)


def plainly(known: Axioms, fluents: int) -> int:
    """The closed state, layer by layer, rule by rule, until nothing changes."""
    state = fluents
    for layer in range(1 + max(known.layers.values())):
        own = [rule for rule in known.rules if known.layers[rule.head] == layer]
        while more := [
            rule for rule in own if not rule.body & ~state and not state >> rule.head & 1
        ]:
            state |= 1 << more[0].head
        for atom in (atom for atom, found in known.layers.items() if found == layer):
            state |= 0 if state >> atom & 1 else 1 << known.complements[atom]
    return state


@given(axioms(), st.integers(0, 15))
@settings(deadline=None)
def test_the_closure_is_the_stratified_model(known: Axioms, true: int) -> None:
    fluents = true | (15 & ~true) << 4
    stale = fluents | known.derived
    assert known.closed(stale) == plainly(known, fluents)


@given(axioms(), st.integers(0, 15), st.data())
@settings(deadline=None)
def test_a_support_makes_its_conditions_true_wherever_it_holds(
    known: Axioms, true: int, data: st.DataObject
) -> None:
    state = known.closed(true | (15 & ~true) << 4)
    conditions = bitset(data.draw(st.sets(st.sampled_from(indices(state)))))
    support = known.support(state, conditions)
    assert not support & known.derived
    for other in range(16):
        closed = known.closed(other | (15 & ~other) << 4)
        if not support & ~closed:
            assert not conditions & ~closed


@given(problems(), st.data())
@DILIGENT
def test_instances_of_rules_derive_what_plain_repetition_derives(
    problem: Problem, data: st.DataObject
) -> None:
    semantics = Semantics(problem)
    dynamic = {"p", "q", "r", "d", "e"}
    derivation = RuleDerivation(semantics.strata, semantics.statics, dynamic)
    things = [Atom("a"), Atom("b")]
    every = [Atom("r"), *(Atom(name, (thing,)) for name in ("p", "q") for thing in things)]
    for _ in range(3):
        state = data.draw(st.sets(st.sampled_from(every)))
        found, plain = (CheckerFacts((), CheckerFacts(state, semantics.statics)) for _ in range(2))
        derivation.add(found)
        for rules in semantics.strata:
            while any(
                [
                    plain.add(substitute_atom(r.head, b))
                    for r in rules
                    for b in list(solve_conditions(r.body, plain, {}))
                ]
            ):
                pass
        assert {*found.named("d"), *found.named("e")} == {*plain.named("d"), *plain.named("e")}

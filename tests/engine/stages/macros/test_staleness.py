"""Editing a domain makes exactly those MACROPs stale whose proof rests on what changed; none of
these is ever used.
"""

import dataclasses
import functools
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from macro_cells import GOLDEN, Example, bundled, golden

from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.lifted.domain_digests import DomainDigests
from cellwright.engine.stages.macros.lookup.macro_query import make_query, signature_of
from cellwright.engine.stages.macros.lookup.macro_repertoire import Repertoire
from cellwright.engine.stages.validation import validate_plan
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.domain_model import DeductiveOperator, Domain, Operator
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library, Record
from cellwright.kb.terms import Number


@functools.cache
def learned() -> dict[str, list[Example]]:
    """The golden plans of two cells, with what was learned from each."""
    return {
        cell: [golden(path) for path in GOLDEN if cell in path.parts]
        for cell in ("bulkhead", "themse")
    }


def slower(operator: Operator) -> Operator:
    """The operator with another duration."""
    return dataclasses.replace(operator, duration=Number(4711))


def undemanding(operator: Operator) -> Operator:
    """The operator without constraints."""
    return dataclasses.replace(operator, body=(), parameters=operator.parameters)


def without_effects(operator: Operator) -> Operator:
    """The operator without its last effect."""
    return dataclasses.replace(operator, effects=operator.effects[:-1])


def edited(domain: Domain, name: str, how: "object") -> Domain:
    assert callable(how)
    operators = tuple(how(each) if each.name == name else each for each in domain.operators)
    return dataclasses.replace(domain, operators=operators)


def uses(found: Example) -> set[str]:
    return {step.operator.name for step in found.plan.steps}


@given(data=st.data())
@settings(max_examples=80, deadline=None)
def test_an_edited_operator_makes_exactly_its_users_stale(data: st.DataObject) -> None:
    examples = learned()[data.draw(st.sampled_from(sorted(learned())))]
    domain = examples[0].problem.domain
    operator = data.draw(st.sampled_from(domain.operators))
    how = data.draw(st.sampled_from([slower, undemanding, without_effects]))
    changed = edited(domain, operator.name, how)
    same = how(operator) == operator
    digests = DomainDigests(changed)
    for found in examples:
        stale = not digests.fresh(found.learned.macrop.depends)
        assert stale == (operator.name in uses(found) and not same)


@pytest.mark.parametrize(
    ("trigger", "stale"),
    [("at", True), ("measured", True), ("holding", False), ("location", False)],
)
def test_an_edited_deductive_operator_makes_those_stale_that_trigger_it(
    trigger: str, stale: bool
) -> None:
    found = bundled("bulkhead/one_point")
    domain = found.problem.domain

    def kept(each: DeductiveOperator) -> bool:
        return each.trigger.atom.name != trigger

    changed = dataclasses.replace(
        domain, deductive_operators=tuple(filter(kept, domain.deductive_operators))
    )
    assert DomainDigests(changed).fresh(found.learned.macrop.depends) is not stale


def test_a_new_deductive_operator_counts() -> None:
    found = bundled("bulkhead/one_point")
    domain = found.problem.domain
    first = next(each for each in domain.deductive_operators if each.trigger.atom.name == "at")
    trigger = dataclasses.replace(
        first.trigger, atom=dataclasses.replace(first.trigger.atom, name="couplant_applied")
    )
    more = (*domain.deductive_operators, dataclasses.replace(first, trigger=trigger))
    changed = dataclasses.replace(domain, deductive_operators=more)
    assert not DomainDigests(changed).fresh(found.learned.macrop.depends)


def test_rules_of_derived_predicates_count() -> None:
    found = bundled("themse/one")
    domain = found.problem.domain
    assert DomainDigests(domain).fresh(found.learned.macrop.depends)
    gone = next(
        name.removeprefix("rules ")
        for name in found.learned.macrop.depends
        if name.startswith("rules ")
    )
    rules = tuple(each for each in domain.rules if each.head.name != gone)
    changed = dataclasses.replace(domain, rules=rules)
    assert DomainDigests(changed).changed(found.learned.macrop.depends) == (f"rules {gone}",)


def test_words_comments_and_weights_do_not_count() -> None:
    found = bundled("themse/one")
    domain = found.problem.domain
    light = {name: dataclasses.replace(each, weight=77) for name, each in domain.predicates.items()}
    changed = dataclasses.replace(domain, predicates=light, words={}, phrases=(), defaults=())
    assert DomainDigests(changed).fresh(found.learned.macrop.depends)


@given(data=st.data())
@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
def test_what_is_found_after_an_edit_is_valid_and_not_stale(
    tmp_path: Path, data: st.DataObject
) -> None:
    examples = learned()[data.draw(st.sampled_from(sorted(learned())))]
    found = data.draw(st.sampled_from(examples))
    operator = data.draw(st.sampled_from(found.problem.domain.operators))
    how = data.draw(st.sampled_from([slower, without_effects]))
    changed = edited(found.problem.domain, operator.name, how)
    problem = dataclasses.replace(found.problem, domain=changed)
    (tmp_path / "library.db").unlink(missing_ok=True)
    with Library(str(tmp_path / "library.db")) as library:
        macrops = [each.learned.macrop for each in examples]
        library.add([Record(each, signature_of(each)) for each in macrops])
        assert_sound(problem, Repertoire(library, changed), operator.name)


def assert_sound(problem: Problem, repertoire: Repertoire, edited_operator: str) -> None:
    asked = make_query(problem, Situation.of(CellDomain(problem), Semantics(problem).initial()))
    assert asked is not None
    hit = repertoire.find(asked)
    if hit is not None:
        assert edited_operator not in {step.operator.name for step in hit.plan.steps}
        assert validate_plan(problem, hit.plan) == []
    else:
        assert repertoire.outdated()

"""What was equal in the plan is equal in the sub-sequence, and an instance of it is what it
came from.
"""

import pytest

from cellwright.engine.pipelines.planning.macros.macro_subsequences import (
    lift_subsequence,
    pattern_of,
)
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.macros.learning.plan_subsequences import recurring_sequences
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.loader import load_plan
from cellwright.kb.terms import Term, Variable, match_term, term_variables
from tests.places import BUNDLED as DOMAINS


@pytest.mark.parametrize("name", ["themse/golden/one.json", "bulkhead/golden/one_point.json"])
def test_a_lifted_subsequence_has_one_variable_for_each_object_and_fits_where_it_came_from(
    name: str,
) -> None:
    problem, plan = load_plan(DOMAINS / name)
    start = Situation.of(CellDomain(problem), Semantics(problem).initial())
    made = [
        (each, lift_subsequence(each, problem, start)) for each in recurring_sequences(plan)[:40]
    ]
    assert any(macrop is not None for _, macrop in made)
    for each, macrop in made:
        if macrop is None:
            continue
        pattern = pattern_of(macrop)
        bindings: dict[Variable, Term] | None = {}
        for step, operator in zip(pattern, each.operators, strict=True):
            bindings = match_term(step, operator, bindings or {})
            assert bindings is not None
        assert len(set(bindings.values())) == len(bindings)
        inside = {variable for step in pattern for variable in term_variables(step)}
        header = [variable for variable in macrop.name.arguments if variable in inside]
        assert inside <= set(macrop.name.arguments)
        assert len(header) == len(set(header))
        different = [(each.left, each.right) for each in macrop.disequalities]
        assert all(left != right for left, right in different)

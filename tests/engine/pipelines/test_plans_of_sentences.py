"""Plans of sentences: what the planner claims of each, the checker of files accepts."""

import pytest

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines import objective
from cellwright.engine.pipelines.plan_files import check_plan
from cellwright.engine.stages.planning import Limits
from cellwright.kb.commands import understand
from cellwright.kb.model.plan import Claims
from tests.kb.commands.test_sentence_sets import CELLS, sentences

EACH = 5  # every fifth sentence is planned


@pytest.mark.slow
@pytest.mark.parametrize("cell", CELLS)
def test_a_plan_is_accepted_with_all_that_is_claimed_of_it(cell: str) -> None:
    target, planned = CELLS[cell](), 0
    for sentence in sentences(cell, "good")[::EACH]:
        problem = understand(target, sentence)
        run = objective.plan(problem, Limits(expansions=20_000))
        if not isinstance(run.outcome, Found):
            continue  # a sentence may ask for what cannot be
        plan = run.timetable.plan if run.timetable else run.outcome.plan
        said = check_plan(problem, plan, "plan", Claims(run.starts or {}, cost=plan.cost))
        assert said == [], sentence
        planned += 1
    assert planned > 0

"""Plans of sentences: what the planner claims of each, the checker of files accepts."""

import pytest

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import plan_objective
from cellwright.engine.pipelines.planning.plan_files import check_plan
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.commands import understand_command
from cellwright.kb.model.plan_model import Claims
from tests.kb.commands.test_sentence_sets import CELLS, sentences

EACH = 5  # every fifth sentence is planned


@pytest.mark.slow
@pytest.mark.parametrize("cell", CELLS)
def test_a_plan_is_accepted_with_all_that_is_claimed_of_it(cell: str) -> None:
    target, planned = CELLS[cell](), 0
    for sentence in sentences(cell, "good")[::EACH]:
        problem = understand_command(target, sentence)
        run = plan_objective.plan_for_objective(problem, SearchLimits(expansions=20_000))
        if not isinstance(run.outcome, Found):
            continue  # a sentence may ask for what cannot be
        plan = run.timetable.plan if run.timetable else run.outcome.plan
        said = check_plan(problem, plan, "plan", Claims(run.starts or {}, cost=plan.cost))
        assert said == [], sentence
        planned += 1
    assert planned > 0

"""What a step brings is told with the next step that needs it."""

from cellwright.engine.pipelines.execution.records import read_atom
from cellwright.engine.pipelines.explanation.uses import needs, uses
from cellwright.engine.pipelines.planning import plan, problem_of
from cellwright.engine.stages.grounding import ground


def test_each_use_is_a_later_step_that_needs_what_is_brought() -> None:
    problem = problem_of("bulkhead/one_point")
    task, outcome = ground(problem), plan(problem)
    made = [step.operator for step in outcome.plan.steps]  # type: ignore[union-attr]
    needed = needs(task, made)
    brought = [
        [fact for fact in sorted(set().union(*needed.values()), key=str) if fact.name in str(step)]
        for step in made
    ]
    for number in range(len(made)):
        for fact, consumer in uses(task, made, brought, number):
            later = made[number + 1 :]
            assert consumer is None or (consumer in later and fact in needed[consumer])


def test_a_fact_that_is_brought_again_counts_for_the_later_step() -> None:
    problem = problem_of("bulkhead/one_point")
    task, outcome = ground(problem), plan(problem)
    step = outcome.plan.steps[-1].operator  # type: ignore[union-attr]
    fact = next(iter(needs(task, [step])[step]))
    other = read_atom("another")
    assert uses(task, [other, step], [[fact], []], 0) == [(fact, step)]
    assert uses(task, [other, other, step], [[fact], [fact], []], 0) == [(fact, None)]

"""What a step brings is told with the next step that needs it."""

from cellwright.engine.pipelines.execution.plan_records import read_ground_atom
from cellwright.engine.pipelines.explanation.step_purposes import later_uses, step_needs
from cellwright.engine.pipelines.planning.checked_plan import plan_problem, problem_of
from cellwright.engine.stages.grounding import ground


def test_each_use_is_a_later_step_that_needs_what_is_brought() -> None:
    problem = problem_of("bulkhead/one_point")
    task, outcome = ground(problem), plan_problem(problem)
    made = [step.operator for step in outcome.plan.steps]  # type: ignore[union-attr]
    needed = step_needs(task, made)
    brought = [
        [fact for fact in sorted(set().union(*needed.values()), key=str) if fact.name in str(step)]
        for step in made
    ]
    for number in range(len(made)):
        for fact, consumer in later_uses(task, made, brought, number):
            later = made[number + 1 :]
            assert consumer is None or (consumer in later and fact in needed[consumer])


def test_a_fact_that_is_brought_again_counts_for_the_later_step() -> None:
    problem = problem_of("bulkhead/one_point")
    task, outcome = ground(problem), plan_problem(problem)
    step = outcome.plan.steps[-1].operator  # type: ignore[union-attr]
    fact = next(iter(step_needs(task, [step])[step]))
    other = read_ground_atom("another")
    assert later_uses(task, [other, step], [[fact], []], 0) == [(fact, step)]
    assert later_uses(task, [other, other, step], [[fact], [fact], []], 0) == [(fact, None)]

"""The order of steps against plain sets of predecessors."""

from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.stages.validation.step_precedence import StepPrecedence
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, Plan, Step, StepId
from cellwright.kb.terms import Function


@st.composite
def plans(draw: st.DrawFn) -> Plan:
    """Plans of up to twelve steps, nearly in sequence or not."""
    steps: list[Step] = []
    for number in range(draw(st.integers(1, 12))):
        after = (
            draw(st.lists(st.sampled_from([each.id for each in steps]), max_size=3))
            if steps
            else []
        )
        if steps and draw(st.booleans()):
            after.append(steps[-1].id)
        name = StepId(
            draw(st.integers(1, 10**6).filter(lambda n: n not in {each.id for each in steps}))
        )
        steps.append(Step(name, Function(f"s{number}"), tuple(dict.fromkeys(after))))
    return Plan(tuple(steps))


@given(plans())
def test_a_step_precedes_another_if_it_is_among_its_predecessors(plan: Plan) -> None:
    order, before = StepPrecedence(plan), plan.predecessors()
    for one in plan.steps:
        for other in plan.steps:
            assert order.precedes(one.id, other.id) == (one.id in before[other.id])


@given(plans())
def test_steps_that_are_not_ordered_are_all_found(plan: Plan) -> None:
    order, before = StepPrecedence(plan), plan.predecessors()
    for place, step in enumerate(plan.steps):
        earlier = [p for p in range(place) if plan.steps[p].id not in before[step.id]]
        assert list(order.unordered_before(step.id)) == earlier


@given(plans(), st.data())
def test_no_step_that_can_come_between_two_others_is_outside_their_range(
    plan: Plan, data: st.DataObject
) -> None:
    order, before = StepPrecedence(plan), plan.predecessors()
    ids = [step.id for step in plan.steps]
    producer = data.draw(st.sampled_from([INITIAL_STEP, *ids]))
    consumer = data.draw(st.sampled_from([GOAL_STEP, *ids]))
    first, last = order.between(producer, consumer)
    for place, each in enumerate(ids):
        early = producer != INITIAL_STEP and each in before[producer]
        late = consumer != GOAL_STEP and consumer in before[each]
        if not early and not late and each not in (producer, consumer):
            assert first <= place < last


def test_a_sequence_keeps_one_mark_for_each_step() -> None:
    steps = tuple(
        Step(StepId(n), Function("s"), (StepId(n - 1),) if n > 1 else ()) for n in range(1, 2_001)
    )
    order = StepPrecedence(Plan(steps))
    assert order.between(StepId(500), StepId(502)) == (499, 502)
    assert not any(list(order.unordered_before(step.id)) for step in steps)

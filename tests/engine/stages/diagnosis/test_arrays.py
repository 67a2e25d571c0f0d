"""Problems as arrays: keys without overlap, outcomes that are sure, causes that belong
together, bounds of single causes.
"""

import itertools
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.troubleshooting import (
    Action,
    Conclusion,
    Setup,
    Troubleshooting,
    field_bits,
)
from cellwright.engine.stages.diagnosis import search_arrays
from tests.engine.stages.diagnosis.fault_cases import (
    certain,
    each_alone,
    isolations,
    names,
    troubles,
    uncertain,
)

SOME = settings(max_examples=60, deadline=None)


def vague(name: str, outcomes: int, causes: int) -> Action:
    """An action with equally likely outcomes."""
    row = tuple(1.0 / outcomes for _ in range(causes))
    return Action(name, 1.0, tuple(f"o{n}" for n in range(outcomes)), (row,) * outcomes)


@given(st.lists(st.integers(1, 40), min_size=1, max_size=60), st.integers(1, 9))
@SOME
def test_fields_of_a_key_lie_within_words_in_their_order_and_waste_no_more_than_they_must(
    outcomes: list[int], situations: int
) -> None:
    actions = tuple(
        vague(f"t{n}", count, 2) if count > 1 else certain(f"t{n}", 1.0, (0, 1))
        for n, count in enumerate(outcomes)
    )
    row = (0,) * len(actions)
    setup = Setup(((0.0,) * len(actions),) * situations, (row,) * situations)
    made = search_arrays.belief_arrays(
        Troubleshooting(names(2), (0.5, 0.5), actions, each_alone(2), setup)
    )
    free = made.situations
    assert 1 << free >= situations
    for action, shift, width in zip(
        actions, made.shifts.tolist(), made.widths.tolist(), strict=True
    ):
        assert width == field_bits(action)
        if not width:
            continue
        assert (1 << width) > len(action.outcomes)
        assert shift // 64 == (shift + width - 1) // 64
        assert shift in (free, 64 * (free // 64 + 1))
        assert shift == free or free % 64 + width > 64
        free = shift + width
    assert made.words >= made.sets + (free + 63) // 64


@given(isolations(6) | troubles())
@SOME
def test_an_outcome_is_shown_for_sure_or_not_at_all(problem: Troubleshooting) -> None:
    made = search_arrays.belief_arrays(problem)
    for index, action in enumerate(problem.actions):
        for cause in range(len(problem.causes)):
            shown = int(made.shown[index, cause])
            if action.certain:
                assert action.likelihoods[shown][cause] == 1.0
            else:
                assert shown == -1


def test_uncertain_actions_show_nothing_and_have_fields() -> None:
    actions = (certain("sure", 1.0, (0, 1)), uncertain("vague", 1.0, (0.3, 1.0)))
    made = search_arrays.belief_arrays(
        Troubleshooting(names(2), (0.5, 0.5), actions, each_alone(2))
    )
    assert made.shown.tolist() == [[0, 1], [-1, -1]]
    assert made.widths.tolist() == [0, 2]


@given(
    st.integers(2, 8).flatmap(
        lambda n: st.tuples(
            st.just(n), st.lists(st.sets(st.integers(0, n - 1), min_size=1, max_size=3), max_size=6)
        )
    )
)
@SOME
def test_causes_belong_together_that_some_conclusions_join(
    drawn: tuple[int, list[set[int]]],
) -> None:
    """Groups are the parts that hang together; the plain way walks from cause to cause."""
    count, shared = drawn
    conclusions = tuple(
        Conclusion(
            str(sorted(own)), tuple(0.0 if cause in own else math.inf for cause in range(count))
        )
        for own in [{cause} for cause in range(count)] + shared
    )
    actions = (certain("all", 1.0, tuple(range(count))),)
    problem = Troubleshooting(names(count), (1.0 / count,) * count, actions, conclusions)
    group = search_arrays._first_of_group(search_arrays.belief_arrays(problem).losses).tolist()
    for a, b in itertools.combinations(range(count), 2):
        assert (group[a] == group[b]) == (b in joined(a, shared))
    assert all(group[cause] == min(joined(cause, shared)) for cause in range(count))


def joined(cause: int, shared: list[set[int]]) -> set[int]:
    """All causes that can be reached from one over the shared conclusions."""
    found = {cause}
    while more := set().union(*(own for own in shared if own & found)) - found:
        found |= more
    return found


@given(troubles())
@SOME
def test_no_cause_costs_less_than_its_bound_when_it_is_known(problem: Troubleshooting) -> None:
    made = search_arrays.belief_arrays(problem)
    dearest = np.asarray(made.costs).min(axis=0)
    for cause in range(len(problem.causes)):
        ways = [conclusion.losses[cause] for conclusion in problem.conclusions]
        for index, action in enumerate(problem.actions):
            helps = sum(action.likelihoods[outcome][cause] for outcome in action.ends)
            ways += [dearest[index] / helps] if helps else []
        assert math.isclose(made.known[cause], min(ways))

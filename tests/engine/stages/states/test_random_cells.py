"""The net by contact class against a slow search of fully specified states, on random small
cells.
"""

from collections import Counter

from hypothesis import HealthCheck, given, settings

from cellwright.engine.model.task_space import ContactNet, FormSpace
from cellwright.engine.stages.states.contact_net import net_of
from cellwright.engine.stages.states.filters import Stability, Templates
from cellwright.engine.stages.states.global_states import reachable_states
from cellwright.engine.stages.states.net_player import NetPlayer, NetSituation
from cellwright.engine.stages.states.state_generation import generate_states
from cellwright.engine.stages.states.token_types import token_types
from cellwright.kb.model.contact_model import ContactModel
from tests.engine.stages.states.random_cells import Recipe, Slow, cell, recipes

few = settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))


def generated(model: ContactModel, full: bool = False) -> tuple[FormSpace, ContactNet]:
    filters = {"stability": Stability(model), "templates": Templates(model)}
    space = generate_states(model, token_types(model, full=full), filters)
    return space, net_of(space, full)


@few
@given(recipe=recipes)
def test_the_count_is_that_of_a_search_of_all_states(recipe: Recipe) -> None:
    model = cell(recipe)
    _, net = generated(model)
    assert net.growth.exact
    assert net.growth.states == len(Slow(model).reachable())


@few
@given(recipe=recipes)
def test_each_firing_has_a_fully_specified_counterpart_and_the_other_way_round(
    recipe: Recipe,
) -> None:
    model = cell(recipe)
    space, net = generated(model)
    player = NetPlayer(space, net)
    for state, contacts in Slow(model).reachable().items():
        assert {each.contact for each in player.firings(NetSituation(state))} == contacts


@few
@given(recipe=recipes)
def test_global_states_by_class_are_those_of_the_search(recipe: Recipe) -> None:
    model = cell(recipe)
    space, net = generated(model)
    player = NetPlayer(space, net)

    def marking(state: frozenset) -> tuple[int, ...]:  # type: ignore[type-arg]
        groups = dict.fromkeys(player.clusters(state).values())
        return tuple(sorted(player.form(each, state) or 0 for each in groups))

    slow = Slow(model)
    graph = reachable_states(space)
    assert graph is not None
    found = slow.reachable()
    assert {marking(state) for state in found} == set(graph)
    for state in found:
        expected = {marking(after) for _, after in slow.following(state)}
        assert {after for _, after in graph[marking(state)]} == expected


@few
@given(recipe=recipes)
def test_tokens_are_conserved_and_capacities_kept(recipe: Recipe) -> None:
    model = cell(recipe)
    space, net = generated(model)
    player = NetPlayer(space, net)
    room = {place.name: dict(place.capacity) for place in net.places}
    type_of = {
        name: each.name for each in space.types for member in each.members for name in member
    }
    for state in Slow(model).reachable():
        there = player.marking(NetSituation(state))
        assert sorted(
            o for clusters in there.values() for each in clusters for o in each
        ) == sorted(type_of)
        for place, clusters in there.items():
            count = Counter(type_of[o] for each in clusters for o in each)
            assert all(count[each] <= room[place].get(each, 0) for each in count)


@few
@given(recipe=recipes)
def test_the_fully_specified_net_has_the_same_states(recipe: Recipe) -> None:
    model = cell(recipe)
    _, by_class = generated(model)
    _, full = generated(model, full=True)
    assert full.growth.states <= by_class.growth.states
    assert len(full.places) >= len(by_class.places)


@few
@given(recipe=recipes)
def test_transfers_take_and_bring_the_same_tokens(recipe: Recipe) -> None:
    _, net = generated(cell(recipe))
    for each in net.transitions:
        for step in each.steps:
            took = Counter({kind: 0 for _, _, kind, _ in step.moved})
            for _, _, kind, count in step.moved:
                took[kind] += count
            assert all(took.values())
        assert {row.source for row in each.transfers} == set(each.inputs)
        assert {row.target for row in each.transfers} == set(each.outputs)

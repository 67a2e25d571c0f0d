"""Plans on generated domains of random cells against a slow search of contact states."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.contact_states.net_domain import generated_domain_file
from cellwright.engine.pipelines.contact_states.net_operators import NetVocabulary
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.states.contact_net import net_of
from cellwright.engine.stages.states.filters import Stability, Templates
from cellwright.engine.stages.states.state_generation import generate_states
from cellwright.engine.stages.states.token_types import token_types
from cellwright.kb.loader import load, with_goals
from cellwright.kb.model.contact_model import Octuple
from tests.engine.stages.states.random_cells import Recipe, Slow, State, cell, recipes


def reached(slow: Slow) -> set[State]:
    """The states that can be reached from the start as it is."""
    start = frozenset(slow.model.initial)
    seen, open_ = {start}, [start]
    while open_:
        for _, after in slow.following(open_.pop()):
            if after not in seen:
                seen.add(after)
                open_.append(after)
    return seen


@settings(max_examples=5, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    recipe=recipes.filter(lambda each: 0 < each.blocks + each.rings < 3 and each.robots == 1),
    chosen=st.integers(0, 10**6),
)
def test_a_pair_of_contacts_is_planned_if_and_only_if_it_can_be_reached(
    recipe: Recipe, chosen: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    model = cell(recipe)
    path = tmp_path_factory.mktemp("cell") / "domain.yaml"
    path.write_text("domain: random\n", "utf-8")
    slow = Slow(model)
    states = reached(slow)
    contacts = sorted({each for state in states for each in state})
    pair = {contacts[chosen % len(contacts)], contacts[chosen // len(contacts) % len(contacts)]}
    outcome = planned(model_path=path, recipe=recipe, goals=pair)
    possible = any(pair <= state for state in states)
    assert isinstance(outcome, Found) == possible


def planned(model_path: Path, recipe: Recipe, goals: set[Octuple]) -> object:
    """The outcome for goals in the generated domain of a random cell."""
    model = cell(recipe)
    space = generate_states(
        model, token_types(model), {"stability": Stability(model), "templates": Templates(model)}
    )
    bare = load(model_path).domain
    file = generated_domain_file(model, net_of(space), bare)
    domain = load(model_path, lambda _: file).domain
    words = NetVocabulary(model, bare)
    said = (
        f"contact({words.point(each.first, {})}, {words.point(each.second, {})})"
        for each in sorted(goals)
    )
    return checked_plan.plan_problem(
        with_goals(domain, ", ".join(said)), SearchLimits(expansions=2_000)
    )

"""While a run goes on, every object is in one place of the net of contact states, and where its
facts put it.
"""

import pytest

from cellwright.engine.pipelines.contact_states.net_marking import (
    Marking,
    marking_of_facts,
    player_of,
)
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.stages.states.net_player import NetPlayer

pytestmark = pytest.mark.slow  # the net of THEMSE takes some seconds


@pytest.fixture(scope="module")
def player() -> NetPlayer:
    return player_of("themse/four")


@pytest.fixture
def facts() -> set[str]:
    return set(map(str, initial_situation(problem_of("themse/four", "", "")).state))


def place_of(name: str, marked: Marking) -> str:
    return next(
        place for place, clusters in marked.items() if any(name in each for each in clusters)
    )


def test_at_the_start_the_net_is_marked_as_its_model_says(
    player: NetPlayer, facts: set[str]
) -> None:
    assert marking_of_facts(player, facts) == player.marking(player.start)


@pytest.mark.parametrize(
    ("at", "together"),
    [
        ("mars_gripper", "mars_gripper"),
        ("slot(furnace, 1)", "furnace"),
        ("slot(freezer, 1)", "freezer"),
        ("slot(drawer, 3)", "drawer"),
    ],
)
def test_a_probe_is_in_the_place_where_its_fact_puts_it(
    player: NetPlayer, facts: set[str], at: str, together: str
) -> None:
    moved = {each for each in facts if not each.startswith("at(probe_3")} | {f"at(probe_3, {at})"}
    marked = marking_of_facts(player, moved)
    assert place_of("probe_3", marked) == place_of(together, marked) != "?"
    everybody = [each for clusters in marked.values() for inside in clusters for each in inside]
    assert sorted(everybody) == sorted(player.token)


def test_a_lid_that_is_taken_off_is_no_longer_locked(player: NetPlayer, facts: set[str]) -> None:
    taken = facts - {"at(lid, rim)"} | {"at(lid, mars_gripper)"}
    assert (
        place_of("lid", marking_of_facts(player, taken))
        == place_of("mars_gripper", marking_of_facts(player, taken))
        != "?"
    )

"""The contact states of THEMSE: the paper's places, its count of fully specified states, and
what holds for more probes.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from itertools import permutations

import pytest

from benchmarks.states import themse
from cellwright.engine.formats.report.cells import net_report as report
from cellwright.engine.pipelines import contact_states
from cellwright.engine.pipelines.contact_states import NetRequest
from cellwright.engine.stages.states.contact_net import net_of
from cellwright.engine.stages.states.net_player import NetPlayer, NetSituation, place_bindings
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.contact_model import ContactModel, Relevance, parse_octuple

APPENDIX = ("MARS_gripper", "THEMSE_drawer", "THEMSE_furnace", "probe")
PROBES, DEPOTS = 4, ("drawer_1", "drawer_2", "drawer_3", "drawer_4", "furnace", "freezer")


@pytest.fixture(scope="module")
def model() -> ContactModel:
    return contact_states.contact_model_of("themse")[0]


def by_hand() -> int:
    """The fully specified states of THEMSE, counted one by one: who is where, and what the
    gripper holds.
    """
    count = 0
    for lid in ("locked", "placed", "stand", "gripper"):
        for in_gripper in (None, *range(PROBES)) if lid != "gripper" else (None,):
            seated = [n for n in range(PROBES) if n != in_gripper]
            for depots in permutations(DEPOTS, len(seated)):
                if lid == "gripper" or in_gripper is not None:
                    count += 1  # the gripper is taken
                    continue
                count += len(("nothing", "drawer", "switch", "lid"))
                on = lid in ("locked", "placed")
                # a probe, where it stands
                count += sum(not (on and depot == "freezer") for depot in depots)
    return count


@pytest.mark.slow
def test_the_whole_cell_has_9960_fully_specified_states(model: ContactModel) -> None:
    assert by_hand() == 9960
    assert contact_states.build_net(model).growth.states == 9960
    full = contact_states.build_net(model, NetRequest(full=True))
    assert full.growth == replace(full.growth, states=9960, exact=True, classes=9960)


def test_the_whole_cell_has_22_places_by_contact_class(model: ContactModel) -> None:
    net = contact_states.build_net(model)
    assert [sum(place.robot is robot for place in net.places) for robot in (True, False)] == [
        11,
        11,
    ]
    freezers = [place.say for place in net.places if place.say.startswith("THEMSE_freezer")]
    assert len(freezers) == 6
    assert "lid_stand free" in {place.say for place in net.places}


def test_the_places_of_the_appendix(
    model: ContactModel, golden: Callable[[str, str], None]
) -> None:
    net = contact_states.build_net(model, NetRequest(APPENDIX))
    assert [place.name for place in net.places] == [f"P{n}" for n in range(1, 9)]
    golden("themse_appendix.txt", report.place_templates(net))


def test_capacities_are_those_of_the_paper(model: ContactModel) -> None:
    net = contact_states.build_net(model, NetRequest(APPENDIX))
    assert dict(net.places[4].capacity) == {"MARS_gripper": 1, "THEMSE_drawer": 1, "probe": 4}


def test_joints_are_manipulated_where_their_handle_is_held(model: ContactModel) -> None:
    net = contact_states.build_net(model)
    said = {place.name: place.say for place in net.places}
    held = {joint: [said[name] for name in places] for joint, places in net.joints.items()}
    assert held == {
        "drawer_slide": ["MARS_gripper holds THEMSE_drawer"],
        "flap_hinge": ["MARS_gripper holds furnace_switch"],
    }


@pytest.mark.parametrize("filters", [("stability", "templates"), ("stability", "collision")])
def test_geometry_finds_what_the_template_says(
    model: ContactModel, filters: tuple[str, ...]
) -> None:
    net = contact_states.build_net(replace(model, filters=filters))
    assert (len(net.places), net.growth.states) == (22, 9960)
    assert filters[1] in {each.filter for each in net.removed}


def test_a_closed_flap_is_in_the_way(model: ContactModel) -> None:
    unrestricted = replace(model, restrictions=(), filters=("stability", "collision"))
    reasons = {each.reason for each in contact_states.build_net(unrestricted).removed}
    assert any("furnace_flap" in each for each in reasons)


def test_what_a_device_brings_is_reported(model: ContactModel) -> None:
    part = contact_states.compare_net_without(model, contact_states.build_net(model), "stand")
    assert part.places > 0
    assert part.transitions > 0
    assert part.states > 0


def test_what_matters_can_be_said(model: ContactModel) -> None:
    every = Relevance(parse_octuple("probe:*.probe_base:* - THEMSE_freezer:*.probe_depot:*"), False)
    assert len(contact_states.build_net(replace(model, relevance=(every,))).places) == 19


@pytest.mark.parametrize("probes", [8, 16])
def test_more_probes_bring_no_more_places(probes: int) -> None:
    started = time.process_time()
    net = contact_states.build_net(themse(probes))
    assert len(net.places) < 40
    assert net.growth.exact
    assert net.growth.states > 10**9
    # a second on an idle machine; see benchmarks/states.py
    assert time.process_time() - started < 10


def test_a_count_for_two_probes_is_that_of_the_fully_specified_net() -> None:
    model = themse(2)
    assert (
        contact_states.build_net(model).growth.states
        == contact_states.build_net(model, NetRequest(full=True)).growth.states
    )


def test_too_many_places_are_not_listed() -> None:
    with pytest.raises(InvalidInput, match="too many to list"):
        contact_states.build_net(themse(16), NetRequest(full=True))


def test_a_stopped_generation_gives_an_upper_bound(model: ContactModel) -> None:
    net = net_of(contact_states.net_space(model, NetRequest(forms=10)))
    assert not net.complete
    assert not net.growth.exact
    assert net.growth.states >= 9960


def test_a_stopped_search_of_states_gives_an_upper_bound(model: ContactModel) -> None:
    net = net_of(contact_states.net_space(model), most=5)
    assert not net.growth.exact
    assert net.growth.states >= 9960
    assert len(net.places) >= 22


def test_a_place_binds_its_variables_to_what_is_there(model: ContactModel) -> None:
    space = contact_states.net_space(model)
    player = NetPlayer(space, net_of(space))
    situation = NetSituation(
        player.start.contacts, (("drawer_slide", "open"), ("flap_hinge", "closed"))
    )
    grip = next(each for each in player.firings(situation) if "probe_3" in str(each.contact))
    held = player.fire(situation, grip)
    place, bound = next(
        each for each in place_bindings(player, held) if each[1].get("O1") == "mars_gripper"
    )
    said = {each.name: each.say for each in player.net.places}
    assert said[place] == "MARS_gripper holds probe in THEMSE_drawer (seat)"
    assert (bound["O2"], bound["O3"], bound["O3.A1"]) == ("probe_3", "drawer", "depot_3")
    with pytest.raises(ValueError, match="cannot fire"):
        player.fire(held, grip)


def test_transitions_wait_for_joints(model: ContactModel) -> None:
    space = contact_states.net_space(model)
    player = NetPlayer(space, net_of(space))
    names = {each.name for each in player.firings(player.start)}
    assert "grip_THEMSE_drawer" in names
    assert not any("probe" in each for each in names)


def test_a_sequence_is_found_on_the_net_alone(model: ContactModel) -> None:
    goal = "probe:probe_2.probe_base:* - THEMSE_furnace:furnace.probe_depot:*"
    found, _ = contact_states.contact_sequence(model, [goal])
    assert found.firings is not None
    assert len(found.firings) == 9


def test_a_goal_that_cannot_be_reached_is_known_as_such(model: ContactModel) -> None:
    goals = [
        f"probe:{each}.probe_base:* - THEMSE_furnace:furnace.probe_depot:*"
        for each in ("probe_1", "probe_2")
    ]
    found, _ = contact_states.contact_sequence(
        model, goals, NetRequest(("MARS_gripper", "THEMSE_furnace", "THEMSE_drawer", "probe"))
    )
    assert found.firings is None

"""Bodies are where the facts of a state say, in the bundled cells and in files that get it
wrong.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinBackend
from cellwright.engine.stages.geometry.reach.cell_check import check_cell
from cellwright.engine.stages.geometry.reach.place_reachability import (
    PlaceReachability,
    ReachedPlace,
)
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import bundled_domains, load_domain, load_problem
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.targets import bundled_devices
from cellwright.kb.terms import Atom, Function, Number


@pytest.fixture(scope="module")
def laboratory() -> GeometricWorld:
    return GeometricWorld.of(load_cell(bundled_domains()["themse"] / "cell.yaml"))


@pytest.fixture(scope="module")
def inspection() -> GeometricWorld:
    return GeometricWorld.of(load_cell(bundled_domains()["bulkhead"] / "cell.yaml"))


def fact(name: str, *arguments: str | Function) -> Atom:
    return Function(
        name, tuple(each if isinstance(each, Function) else Function(each) for each in arguments)
    )


def _slot(unit: str, number: int) -> Function:
    return Function("slot", (Function(unit), Number(number)))


def close(world: GeometricWorld, other: GeometricWorld, body: str) -> bool:
    return bool(np.abs(world.pose("world", body) - other.pose("world", body)).max() < 1e-9)


def test_at_the_start_drawer_flap_and_lid_are_closed(laboratory: GeometricWorld) -> None:
    """The file shows them open."""
    state = Semantics(load_problem("themse/four")).initial()
    world = world_after_facts(laboratory, state)
    slid = transforms.inverse(laboratory.pose("world", "drawer")) @ world.pose("world", "drawer")
    assert np.abs(slid - transforms.translation(0.26, 0, 0)).max() < 1e-9
    for n in (1, 2, 3, 4):
        assert (
            np.abs(
                world.pose("drawer", f"probe_{n}") - laboratory.pose("drawer", f"probe_{n}")
            ).max()
            < 1e-9
        )
    # it lies flat over the shaft
    assert abs(float(world.pose("furnace", "flap")[0, 2]) + 1.0) < 1e-9
    assert np.abs(world.pose("bayonet", "lid")[:3, 3] - [0, 0, 0]).max() < 1e-9
    assert close(world_after_facts(world, [fact("at", "lid", "stand")]), laboratory, "lid")


def test_the_lid_turns_with_its_bayonet_and_both_fingers_close_on_what_they_hold(
    laboratory: GeometricWorld,
) -> None:
    lid = fact("at", "lid", "rim")
    turned, loose = (
        world_after_facts(laboratory, [lid, fact("position", "bayonet", each)]).pose("world", "lid")
        for each in ("locked", "unlocked")
    )
    between = transforms.inverse(loose) @ turned
    assert abs(np.degrees(np.arctan2(between[1, 0], between[0, 0])) - 40) < 1e-9
    held = world_after_facts(laboratory, [fact("at", "probe_2", "mars_gripper")])
    apart = held.pose("finger_left", "finger_right")[1, 3]
    assert abs(apart + 0.07 - 2 * 0.007) < 1e-9
    assert (
        abs(
            world_after_facts(held, [fact("free", "mars_gripper")]).pose(
                "finger_left", "finger_right"
            )[1, 3]
            + 0.07
        )
        < 1e-9
    )


def test_what_is_gripped_moves_with_the_arm_until_it_is_put_down(
    laboratory: GeometricWorld,
) -> None:
    world = world_after_facts(laboratory, [fact("at", "probe_2", "mars_gripper")])
    grip = transforms.inverse(
        world.pose("probe_2", "world") @ world.pose("world", "manutec_r3.tool")
    )
    assert np.abs(transforms.inverse(grip) - laboratory.grip("probe_2")).max() < 1e-9
    turned = world.moved("manutec_r3", world.configurations["manutec_r3"] + 0.2)
    assert not close(turned, world, "probe_2")
    place = laboratory.cell.places["slot(furnace, 1)"]
    down = world_after_facts(turned, [Function("at", (Function("probe_2"), _slot("furnace", 1)))])
    target = down.pose("world", place.placement.parent) @ transforms.of_pose(place.placement.pose)
    assert np.abs(down.pose("world", "probe_2") @ down.grip("probe_2") - target).max() < 1e-9


def test_an_arm_that_reaches_a_depot_has_the_probe_between_its_fingers(
    laboratory: GeometricWorld,
) -> None:
    """Position and direction of the grip are those of the tool; about its own z the tool may
    turn.
    """
    for number in (1, 2, 3, 4):
        answer = PlaceReachability(laboratory, BuiltinBackend()).at(
            laboratory.cell.places[f"slot(drawer, {number})"]
        )
        assert isinstance(answer, ReachedPlace)
        there = laboratory.moved("manutec_r3", answer.q[0])
        seen = there.pose("manutec_r3.tool", f"probe_{number}") @ there.grip(f"probe_{number}")
        assert np.abs(seen[:3, 3]).max() < 1e-8
        assert np.abs(seen[:3, 2] - [0, 0, 1]).max() < 1e-8


def test_tools_are_in_the_rack_or_in_the_hand(inspection: GeometricWorld) -> None:
    state = Semantics(load_problem("bulkhead/both_tools")).initial()
    racked = world_after_facts(inspection, state)
    for tool in ("us_probe", "slra"):
        assert racked.supports(tool)[1] in ("tool_rack", "t3_746.tool")
    held = world_after_facts(inspection, [fact("holding", "t3_746", "us_probe")])
    assert held.supports("us_probe")[1] == "t3_746.tool"
    back = world_after_facts(held, [fact("location", "us_probe", "t3_746", "in_rack")])
    assert close(back, inspection, "us_probe")


@settings(max_examples=30, deadline=None)
@given(st.permutations(range(4)))
def test_the_order_of_facts_means_nothing_and_following_twice_changes_nothing(
    order: list[int],
) -> None:
    world = GeometricWorld.of(load_cell(bundled_domains()["themse"] / "cell.yaml"))
    facts = [
        Function("at", (Function(f"probe_{n + 1}"), _slot("drawer", order[n] + 1)))
        for n in range(4)
    ]
    once = world_after_facts(world, facts)
    for again in (world_after_facts(world, facts[::-1]), world_after_facts(once, facts)):
        assert all(close(once, again, f"probe_{n}") for n in (1, 2, 3, 4))
    assert close(once, world, "probe_1") == (order[0] == 0)


def test_facts_about_what_has_no_geometry_move_nothing(laboratory: GeometricWorld) -> None:
    odd = [fact("at", "probe_9", "stand"), fact("at", "lid", "ceiling"), fact("free", "stand")]
    world = world_after_facts(laboratory, odd)
    assert dict(world.placed) == dict(laboratory.placed)


CELL = """cell: bench
arms: {ur5: {model: ur5}}
parts: {bolt: {shapes: [{box: [0.1, 0.1, 0.1]}]}}
places: {bin: {at: [0.3, 0, 0.3]}}
locations:
"""


@pytest.mark.parametrize(
    ("entry", "code", "said"),
    [
        ("at(Item, Place): {body: Item}", "K005", "no place, or two"),
        ("at(Item, Place): {body: Item, place: bin, in: ur5.tool}", "K005", "no place, or two"),
        ("at(Item, Place): {body: Thing, place: Place}", "K105", "no variable 'Thing'"),
        ("at(Item, Place): {body: Item, in: Hand.tool}", "K105", "no variable 'Hand'"),
        ("at(Item, Place): {body: nut, place: Place}", "K101", "unknown body 'nut'"),
        ("at(Item, Place): {body: Item, place: tin}", "K101", "unknown place 'tin'"),
        ("at(Item, Place): {body: Item, in: ur5.tole}", "K101", "unknown frame 'ur5.tole'"),
        ("at(Item, Place: {body: Item, place: Place}", "K106", ""),
    ],
)
def test_a_location_that_means_nothing_is_told(
    entry: str, code: str, said: str, tmp_path: Path
) -> None:
    (tmp_path / "cell.yaml").write_text(
        f'{CELL}  "{entry.split(": {")[0]}": {{{entry.split(": {")[1]}\n'
    )
    with pytest.raises(InvalidInput) as error:
        load_cell(tmp_path / "cell.yaml")
    assert any(each.code == code and said in each.message for each in error.value.diagnostics)


@pytest.mark.parametrize(
    ("old", "code"), [("at(Item, Place)", "K101"), ("at(Item, mars_gripper)", "K102")]
)
def test_a_location_that_the_domain_does_not_know_is_told(
    old: str, code: str, tmp_path: Path
) -> None:
    new = {"K101": "in(Item, Place)", "K102": "at(Item, mars_gripper, now)"}[code]
    cell = shutil.copytree(bundled_domains()["themse"], tmp_path / "themse") / "cell.yaml"
    device = (
        shutil.copytree(bundled_devices()["gripper"], tmp_path / "themse" / "devices" / "gripper")
        / "cell.yaml"
    )
    was, becomes = (each.replace("mars_gripper", "$hand") for each in (old, new))
    device.write_text(device.read_text().replace(f"{was}: {{body", f"{becomes}: {{body"))
    assert {each.code for each in check_cell(cell, load_domain("themse"))} == {code}

"""PNML: what is written is read as it was, for place/transition nets and for symmetric nets."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.formats.interop.pnml import (
    read_pnml,
    read_text,
    symmetric_net,
    unfold_net,
    write_contact_net,
    write_pnml,
)
from cellwright.engine.model.task_space import (
    ContactNet,
    PetriArc,
    PetriNet,
    PetriPlace,
    PetriTransition,
)
from cellwright.engine.pipelines import contact_states
from cellwright.engine.pipelines.contact_states import NetRequest
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.files import File

PARTS = ("MARS_gripper", "THEMSE_furnace", "THEMSE_drawer", "probe")
FEW = ("THEMSE_drawer", "probe")  # fully specified, four parts have thousands of states


@pytest.fixture(scope="module")
def nets() -> dict[bool, ContactNet]:
    """The net of a part of THEMSE, by class and fully specified."""
    model, _ = contact_states.contact_model_of("themse")
    return {
        full: contact_states.build_net(model, NetRequest(FEW if full else PARTS, full))
        for full in (False, True)
    }


def read_again(net: PetriNet) -> PetriNet:
    return read_text(File.of("net.pnml", write_pnml(net)))


@pytest.mark.parametrize("full", [False, True])
def test_an_unfolded_net_is_read_as_it_was_written(
    nets: dict[bool, ContactNet], full: bool
) -> None:
    net = unfold_net(nets[full])
    assert read_again(net) == net
    assert not net.coloured


def test_a_symmetric_net_is_read_as_it_was_written(nets: dict[bool, ContactNet]) -> None:
    net = symmetric_net(nets[False])
    assert read_again(net) == net
    assert net.coloured


def test_a_document_is_written_as_it_was_read(nets: dict[bool, ContactNet], tmp_path: Path) -> None:
    for coloured in (False, True):
        (tmp_path / "net.pnml").write_text(write_contact_net(nets[False], coloured), "utf-8")
        assert write_pnml(read_pnml(tmp_path / "net.pnml")) == write_contact_net(
            nets[False], coloured
        )


def test_every_token_is_in_one_place_at_the_start(nets: dict[bool, ContactNet]) -> None:
    net = symmetric_net(nets[False])
    tokens = sorted(token for each in net.types.values() for token in each)
    assert sorted(token for place in net.places for token in place.marking) == tokens


def test_a_transition_brings_the_tokens_that_it_takes(nets: dict[bool, ContactNet]) -> None:
    net = symmetric_net(nets[False])
    for each in net.transitions:
        took = sorted(name for arc in net.arcs if arc.target == each.id for name in arc.variables)
        brought = sorted(
            name for arc in net.arcs if arc.source == each.id for name in arc.variables
        )
        assert took == brought == sorted(name for name, _ in each.variables)


names = st.text("abc_<&\"'é ", min_size=1, max_size=6).map(lambda text: f"n{text}n")
notes = st.lists(names, max_size=2).map(tuple)


@st.composite
def petri_nets(draw: st.DrawFn) -> PetriNet:
    places = tuple(
        PetriPlace(f"p{n}", draw(names), draw(st.integers(0, 3)), (), draw(notes))
        for n in range(draw(st.integers(1, 3)))
    )
    transitions = tuple(
        PetriTransition(f"t{n}", draw(names), (), draw(notes))
        for n in range(draw(st.integers(1, 3)))
    )
    arcs = tuple(
        PetriArc(
            f"a{n}",
            *((p.id, t.id) if draw(st.booleans()) else (t.id, p.id)),
            draw(st.integers(1, 9)),
        )
        for n, (p, t) in enumerate((p, t) for p in places for t in transitions)
    )
    return PetriNet("net", places, transitions, arcs)


@given(net=petri_nets())
def test_any_place_transition_net_survives(net: PetriNet) -> None:
    assert read_again(net) == net


FOREIGN = """<pnml xmlns="http://www.pnml.org/version-2009/grammar/pnml">
<net id="n" type="http://www.pnml.org/version-2009/grammar/ptnet"><page id="g"><page id="inner">
<place id="p"><initialMarking><graphics/><text> 2 </text></initialMarking></place></page>
<transition id="t"/><arc id="a" source="p" target="t"/>{}</page></net></pnml>"""


def test_what_others_write_is_read() -> None:
    net = read_text(File.of("foreign.pnml", FOREIGN.format("")))
    assert [(place.id, place.count) for place in net.places] == [("p", 2)]
    assert net.arcs == (PetriArc("a", "p", "t", 1),)


@pytest.mark.parametrize(
    "wrong",
    [
        '<arc id="b" source="p" target="p"/>',
        '<arc id="b" source="p"/>',
        '<place id="q"><initialMarking><text>x</text></initialMarking></place>',
    ],
)
def test_what_is_no_net_is_refused(wrong: str) -> None:
    with pytest.raises(InvalidInput, match="K811"):
        read_text(File.of("wrong.pnml", FOREIGN.format(wrong)))


PLAIN_NET = (
    '<pnml xmlns="http://www.pnml.org/version-2009/grammar/pnml"><net id="n" '
    'type="http://www.pnml.org/version-2009/grammar/ptnet"><page id="g"><place id="p"/><place '
    'id="q"/>'
    '<transition id="t"/>{}</page></net></pnml>'
)


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ('<arc id="a" source="p" target="t"><type value="inhibitor"/></arc>', "type 'inhibitor'"),
        ('<arc id="a" source="p" target="t"><type><text>reset</text></type></arc>', "type 'reset'"),
        (
            '<arc id="a" source="p" target="t"><arctype><text>read</text></arctype></arc>',
            "type 'read'",
        ),
        ('<arc id="a" source="p" target="t" type="inhibitor"/>', "type 'inhibitor'"),
        ('<place id="r"><capacity><text>3</text></capacity></place>', "capacity of 3"),
        ('<referencePlace id="r" ref="t"/>', "leads to no place"),
        ('<referencePlace id="r" ref="s"/><referencePlace id="s" ref="r"/>', "leads to no place"),
    ],
)
def test_what_means_more_than_a_plain_net_is_refused(tmp_path: Path, parts: str, said: str) -> None:
    (tmp_path / "n.pnml").write_text(PLAIN_NET.format(parts))
    with pytest.raises(InvalidInput, match=said):
        read_pnml(tmp_path / "n.pnml")


def test_reference_nodes_stand_for_their_nodes(tmp_path: Path) -> None:
    parts = (
        '<page id="h"><referencePlace id="r" ref="s"/><referencePlace id="s" ref="q"/>'
        '<referenceTransition id="u" ref="t"/><arc id="a" source="r" target="u"><type '
        'value="normal"/></arc></page>'
    )
    (tmp_path / "n.pnml").write_text(PLAIN_NET.format(parts))
    (arc,) = read_pnml(tmp_path / "n.pnml").arcs
    assert (arc.source, arc.target) == ("q", "t")

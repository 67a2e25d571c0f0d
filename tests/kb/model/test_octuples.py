"""Octuples: the normal form, and the variants of the paper's appendix."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.kb.model.contact_model import (
    NotAnOctuple,
    Octuple,
    Quadruple,
    match_quadruple,
    number_objects,
    parse_octuple,
)

CLASSES = ("MARS_gripper", "THEMSE_drawer", "THEMSE_furnace", "probe")
APPENDIX = {
    "MARS_gripper:O1.grip_source:grip-*:void.grip-target:void": "MARS_gripper:O1.grip_source:grip "
    "- "
    "*:void.grip_target:void",
    "THEMSE_furnace:O1.probe_depot:depot-*:void.probe_base:void": "THEMSE_furnace:O1.probe_depot:depot "
    "- "
    "*:void.probe_base:void",
    "THEMSE_drawer:O1.probe_depot:A2probe:O2.probe_base:base": "THEMSE_drawer:O1.probe_depot:A2 - "
    "probe:O2.probe_base:base",
    "probe:O2.grip_target:grip*:void.grip_source:void": "probe:O2.grip_target:grip - "
    "*:void.grip_source:void",
    "THEMSE_drawer:O1.grip_target:grip-MARS_gripper:O6.grip_source:grip": "THEMSE_drawer:O1.grip_target:grip "
    "- "
    "MARS_gripper:O6.grip_source:grip",
    "THEMSE_drawer:O1.probe_depot:A1probe:O2.probe_base.base": "THEMSE_drawer:O1.probe_depot:A1 - "
    "probe:O2.probe_base:base",
    "MARS_gripper:O6.grip_source:A5probe:O2.grip_target.grip": "MARS_gripper:O6.grip_source:A5 - "
    "probe:O2.grip_target:grip",
    "MARS_gripper:O1.grip_source:A1probe:O2.grip_target.A2": "MARS_gripper:O1.grip_source:A1 - "
    "probe:O2.grip_target:A2",
    "MARS_gripper:O1.grip_source:gripprobe:O2.grip_target.grip": "MARS_gripper:O1.grip_source:grip "
    "- "
    "probe:O2.grip_target:grip",
    "THEMSE_furnace:O3.probe_depot.depotprobe:O2.probe_base.base": "THEMSE_furnace:O3.probe_depot:depot "
    "- "
    "probe:O2.probe_base:base",
    "THEMSE_furnace:O1.probe_depot.A1probe:O2.probe_base.A2": "THEMSE_furnace:O1.probe_depot:A1 - "
    "probe:O2.probe_base:A2",
}


@pytest.mark.parametrize("printed", APPENDIX)
def test_contacts_of_the_appendix_are_read_as_they_were_printed(printed: str) -> None:
    assert str(parse_octuple(printed, CLASSES)) == APPENDIX[printed]


@pytest.mark.parametrize(
    "printed", [each for each in APPENDIX if "gripprobe" not in each and "depotprobe" not in each]
)
def test_where_a_variable_or_a_joker_ends_no_class_need_be_known(printed: str) -> None:
    assert str(parse_octuple(printed)) == APPENDIX[printed]


names = st.from_regex(r"[a-z][a-z0-9_]{0,6}", fullmatch=True)
instances = names | st.sampled_from(["*", "O1", "void"])
quadruples = st.builds(
    Quadruple, names | st.just("*"), instances, names, names | st.sampled_from(["*", "A2"])
)


@given(first=quadruples, second=quadruples)
def test_the_normal_form_is_read_as_it_was_written(first: Quadruple, second: Quadruple) -> None:
    octuple = Octuple(first, second)
    assert parse_octuple(str(octuple)) == octuple
    assert parse_octuple(str(octuple).replace(" ", "\n ")) == octuple


@pytest.mark.parametrize(
    "wrong",
    [
        "",
        "a:b.c:d",
        "a:b.c:d - e:f.g",
        "a:b.c:d - e:f.g:h.i",
        "a:b.c:d e:f.g:h",
        "a:b.c:1 - e:f.g:h",
    ],
)
def test_other_texts_are_no_octuples(wrong: str) -> None:
    with pytest.raises(NotAnOctuple):
        parse_octuple(wrong)


def test_the_order_of_a_contact_class_is_what_it_specifies() -> None:
    templates = [
        "*:*.grip_source:* - *:*.grip_target:*",
        "MARS_gripper:*.grip_source:* - probe:*.grip_target:*",
        "probe:*.probe_base:* - THEMSE_drawer:*.probe_depot:depot_1",
    ]
    assert [parse_octuple(each).order for each in templates] == [1, 2, 3]


def test_the_same_variable_is_the_same_object() -> None:
    template = Quadruple("probe", "P", "base", "*")
    bound = match_quadruple(template, Quadruple("probe", "p1", "base", "b"), ["probe"])
    assert bound == {"P": "p1"}
    assert (
        match_quadruple(template, Quadruple("probe", "p2", "base", "b"), ["probe"], bound) is None
    )
    assert (
        match_quadruple(
            template, Quadruple("ni_probe", "p1", "base", "b"), ["ni_probe", "probe"], bound
        )
        == bound
    )


def test_objects_are_numbered_as_they_appear() -> None:
    given = [parse_octuple("a:x.k:k - b:y.l:l"), parse_octuple("b:y.m:m - *:void.n:void")]
    assert [str(each) for each in number_objects(given)] == [
        "a:O1.k:k - b:O2.l:l",
        "b:O2.m:m - *:void.n:void",
    ]

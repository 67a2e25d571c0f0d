"""What is offered at a place, and what is said about a name."""

from pathlib import Path

import pytest
from test_names_in_files import LABORATORY, index_of

from cellwright.kb.editing.completions import list_completions
from cellwright.kb.editing.name_descriptions import DomainKnowledge, describe_name
from cellwright.kb.editing.name_index import FileIndex, NameIndex
from cellwright.kb.editing.yaml_context import context_at


@pytest.fixture(scope="module")
def themse() -> NameIndex:
    return index_of(LABORATORY)


def offered(index: NameIndex, name: str, old: str, new: str) -> set[str]:
    """What is offered behind `new`, which stands in place of `old` in a file."""
    path = next(path for path in index.files if path.endswith(name))
    text = index.files[path].text
    place = text.index(old)
    file = FileIndex.of(path, text[:place] + new + text[place + len(old) :])
    return {
        each.label
        for each in list_completions(NameIndex({**index.files, path: file}), file, place + len(new))
    }


@pytest.mark.parametrize(
    ("old", "new", "with_", "without"),
    [
        ("adds: at(Item, "
        "mars_gripper)", "adds: ", {"at", "heated"}, {"capacity", "accessible", "probe"}),
        ("where: fits(Item, "
        "Place)", "where: fi", {"fits", "accessible", "probe"}, {"at", "heated"}),
        ("adds: at(Item, "
        "mars_gripper)", "adds: "
        "at(Item, ", {"rim", "mars_gripper", "slot", "Place"}, {"probe_1", "open"}),
        ("adds: position(drawer, "
        "open)", "adds: position(drawer, ", {"open", "locked"}, {"drawer", "rim", "slot"}),
        ("adds: position(drawer, "
        "open)", "adds: position(", {"drawer", "flap"}, {"open", "probe_1"}),
        ("    duration: 6 s\n", "    dur", {"duration", "cost"}, {"adds:", "domain", "free"}),
        ("resources: mars_gripper, drawer", "resources: mars", {"mars_gripper", "drawer"}, {"at"}),
        ("fits(item, place): {}", "fits(it", {"item", "place", "int"}, {"at"}),
        ("lid: item", "lid: it", {"item", "device"}, {"at", "rim"}),
        ("command: {stream: arm(open_drawer), reply: "
        "done}", "command: {stream: arm(open_drawer), re", {"reply", "result"}, {"adds"}),
        ("units: {time: s}", "units: {time: ", {"s", "min", "h", "ms"}, {"at"}),
        ("goal: at(lid, stand)", "goal: at(lid, ", {"stand", "rim"}, {"probe_1"}),
    ],
)  # fmt: skip
def test_what_fits_is_offered_and_nothing_else(
    themse: NameIndex, old: str, new: str, with_: set[str], without: set[str]
) -> None:
    found = offered(themse, "domain.yaml", old, new)
    assert with_ <= found
    assert not without & found


@pytest.mark.parametrize(
    ("old", "new", "with_", "without"),
    [
        (
            "stages: heated(P, 15 min), cooled",
            "stages: heated(",
            {"probe_1", "P"},
            {"rim", "drawer"},
        ),
        ("stages: heated(P, 15 min), cooled", "stages: ", {"heated", "stored"}, {"capacity"}),
        ("{P: [probe_1, probe_2]}", "{P: [probe_1, ", {"probe_2"}, {"at"}),
        ("workflow:", "wor", {"workflow", "goals"}, {"operators"}),
    ],
)
def test_problems_are_completed(
    themse: NameIndex, old: str, new: str, with_: set[str], without: set[str]
) -> None:
    found = offered(themse, "problems/two.yaml", old, new)
    assert with_ <= found
    assert not without & found


def test_rules_and_faults_are_completed(themse: NameIndex) -> None:
    assert {"part_of", "numbered", "depot"} <= offered(
        themse, "rules.lp", "home(P, D) :- own", "home(P, D) :- "
    )
    assert {"probe_1", "probe_4"} <= offered(themse, "rules.lp", "numbered(probe_1", "own_depot(")
    assert {"probe_slipped", "arm_offset"} <= offered(
        themse, "faults.yaml", "causes: {probe_slipped", "causes: {pro"
    )
    assert {"pick", "heat"} <= offered(themse, "faults.yaml", "of: pick(Item, Place)", "of: ")


def test_sentences_of_the_domain_are_offered_for_a_command(themse: NameIndex) -> None:
    found = offered(themse, "problems/sentence.yaml", "process probes 1", "op")
    assert {"open the drawer", "process <probe> for <time>"} <= found


def test_nothing_is_offered_in_a_comment_or_a_text(themse: NameIndex) -> None:
    assert not offered(themse, "domain.yaml", "# what the gripper can hold", "# wh")
    assert not offered(themse, "rules.lp", "% The cell", "% Th")


def test_a_place_is_known_from_the_lines_above_it() -> None:
    text = (
        "problem: p\ndomain: d\nworkflow:\n- for: {P: [a]}\n  stages: heated(P,\n    15 min), sto"
    )
    found = context_at(text, len(text))
    assert (found.path, found.written, found.key) == (
        ("workflow", 0, "stages"),
        "15 min), sto",
        False,
    )


@pytest.mark.parametrize(
    ("name", "where", "said"),
    [
        ("domain.yaml", "at(item, place)", ["at(item, place)", "fluent of weight 3", "read"]),
        (
            "domain.yaml",
            "own_depot(probe",
            ["static", "given by a problem; else the slot of the drawer"],
        ),
        ("domain.yaml", "preconditions: free", ["what must hold while the step lasts"]),
        ("domain.yaml", "probe: item", ["type", "`probe_1`"]),
        (
            "domain.yaml",
            "pick(Item, Place):",
            ["pick(Item: item, Place: place)", "for example `pick(lid, rim)`"],
        ),
        ("domain.yaml", "Item, Place):", ["Item: item"]),
        ("rules.lp", "numbered(probe_1", ["predicate that only rules define"]),
        ("rules.lp", "N) :- capacity", ["N: int", "variable"]),
        ("problems/two.yaml", "workflow:", ["stages that must be reached in order"]),
    ],
)
def test_a_name_is_described(themse: NameIndex, name: str, where: str, said: list[str]) -> None:
    file = next(file for path, file in themse.files.items() if path.endswith(name))
    known = DomainKnowledge(
        {"pick": "pick(lid, rim)"}, {"pick": {"Item": "item", "Place": "place"}}
    )
    found = describe_name(themse, file, file.text.index(where), known)
    assert found is not None
    for each in said:
        assert each in found[0]


def test_every_place_of_every_file_is_answered(themse: NameIndex) -> None:
    """No place makes an answer fail; each tenth is tried."""
    for path, file in themse.files.items():
        if Path(path).suffix in (".yaml", ".lp"):
            for offset in range(0, len(file.text), 97):
                list_completions(themse, file, offset)
                describe_name(themse, file, offset, DomainKnowledge())

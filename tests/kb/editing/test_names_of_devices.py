"""The names that a domain has from devices: where they stand in the files of devices, also
while the domain is broken.
"""

from pathlib import Path

import pytest

from cellwright.kb.editing.completions import list_completions
from cellwright.kb.editing.name_descriptions import DomainKnowledge, describe_name
from cellwright.kb.editing.name_index import (
    DeviceIndex,
    FileIndex,
    NameIndex,
    Symbol,
    devices_in_use,
    section_of_uses,
)
from cellwright.kb.editing.text_changes import NotRenamed, rename_occurrences
from cellwright.kb.loader import load
from cellwright.kb.targets import BUNDLED_DOMAINS

DOMAIN = """domain: cell
use:
  gripper: {}
  rack: {}
  # two of them
  furnace: {}

  oven: {device: furnace, capacity: 2}
units: {time: s}
statics:
  clean(probe): {}
"""


def index_of(folder: Path, text: str = DOMAIN) -> tuple[NameIndex, FileIndex]:
    path = folder / "domain.yaml"
    file = FileIndex.of(str(path), text)
    used = devices_in_use(section_of_uses(text), path)
    return NameIndex({str(path): file, **{f"{each.path}#{each.use}": each for each in used}}), file


def test_the_section_of_uses_ends_where_the_next_one_begins() -> None:
    assert section_of_uses(DOMAIN) == DOMAIN[DOMAIN.index("use:") : DOMAIN.index("units:")]
    assert section_of_uses("domain: d\nuses: {}\n") == ""
    assert section_of_uses("use: {a: {}}\ntypes:\n  a: object\n") == "use: {a: {}}\n"


def test_all_names_of_a_cell_of_devices_are_known(tmp_path: Path) -> None:
    (tmp_path / "domain.yaml").write_text(DOMAIN)
    domain, (index, _) = load(tmp_path / "domain.yaml").domain, index_of(tmp_path)
    assert {each.name for each in index.of_space("predicate")} == set(domain.predicates)
    assert {each.name for each in index.of_space("operator")} == {
        each.name for each in domain.operators
    }
    assert {each.name for each in index.of_space("object")} == set(domain.objects)


def test_a_name_of_a_device_stands_where_its_parameter_is_written(tmp_path: Path) -> None:
    index, _ = index_of(tmp_path)
    for use, name in (("furnace", "heat"), ("oven", "oven_heat")):
        ((file, place),) = index.definitions(Symbol("operator", name))
        assert isinstance(file, DeviceIndex)
        assert (file.path, file.use) == (
            str(BUNDLED_DOMAINS / "devices" / "furnace" / "device.yaml"),
            use,
        )
        assert file.text[place.start : place.end] == "$heat"
    for file in index.files.values():
        for _, each in file.occurrences():
            written = file.text[each.start : each.end]
            assert "$" in written or each.name == written or each.ranged


@pytest.mark.parametrize(
    ("right", "wrong", "lost"),
    [
        ("  rack: {}", "  rack: {capacity: [", set()),
        ("  rack: {}", "  rakc: {}", {"rack"}),
        ("  rack: {}", "  rack: {capasity: 3}", {"rack"}),
        ("units: {time: s}", "units: {time", set()),
        ("capacity: 2", "capacity: [", set()),
    ],
)
def test_what_is_wrong_with_one_use_hides_no_other(
    tmp_path: Path, right: str, wrong: str, lost: set[str]
) -> None:
    index, _ = index_of(tmp_path, DOMAIN.replace(right, wrong))
    uses = {each.use for each in index.files.values() if isinstance(each, DeviceIndex)}
    assert {"gripper", "furnace", "rack"} - lost <= uses
    assert ("operator", "pick") in index.declarations


def test_a_device_is_described_and_its_names_are_offered(tmp_path: Path) -> None:
    index, file = index_of(tmp_path)
    said = describe_name(index, file, DOMAIN.index("furnace"), DomainKnowledge())
    assert said is not None
    assert "a furnace that heats the probes in it" in said[0]
    text = DOMAIN + "operators:\n  look(Probe):\n    preconditions: pos\n"
    index, file = index_of(tmp_path, text)
    assert "position" in {each.label for each in list_completions(index, file, len(text) - 1)}


def test_a_name_of_a_device_is_not_renamed(tmp_path: Path) -> None:
    text = DOMAIN + "operators:\n  look(Probe):\n    preconditions: free(gripper)\n"
    index, file = index_of(tmp_path, text)
    with pytest.raises(NotRenamed, match=r"a name in the device '\w+'.*cellwright devices show"):
        list(rename_occurrences(index, file, text.index("free(gripper)"), "idle"))
    assert list(rename_occurrences(index, file, text.index("clean(probe)"), "washed"))

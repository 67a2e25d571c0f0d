"""The index of names: where each is declared and used, across YAML and ASP, also in broken
texts.
"""

import shutil
from pathlib import Path

import pytest

from cellwright.kb.editing.expression_tokens import mentions_in
from cellwright.kb.editing.name_index import (
    DeviceIndex,
    FileIndex,
    NameIndex,
    Symbol,
    devices_in_use,
    section_of_uses,
)
from cellwright.kb.loader import load
from cellwright.kb.loader.tolerant_yaml import piece_tree, split_pieces
from cellwright.kb.targets import BUNDLED_DOMAINS

LABORATORY = Path(__file__).with_name("laboratory")  # declares all of its names itself

DOMAINS = ["themse", "bulkhead", "centrifuge", "handey"]


def index_of(folder: Path) -> NameIndex:
    """All files of a domain."""
    files = [*folder.glob("*.yaml"), *folder.glob("*.lp"), *folder.glob("problems/*.yaml")]
    found = {str(path): FileIndex.of(str(path), path.read_text()) for path in sorted(files)}
    domain = folder / "domain.yaml"
    devices = devices_in_use(section_of_uses(domain.read_text()), domain)
    return NameIndex({**found, **{f"{each.path}#{each.use}": each for each in devices}})


def file_of(index: NameIndex, name: str) -> FileIndex:
    return next(file for path, file in index.files.items() if path.endswith(name))


@pytest.fixture(scope="module")
def themse() -> NameIndex:
    return index_of(LABORATORY)


@pytest.mark.parametrize("name", DOMAINS)
def test_the_index_declares_what_the_loader_declares(name: str) -> None:
    domain, index = (
        load(BUNDLED_DOMAINS / name / "domain.yaml").domain,
        index_of(BUNDLED_DOMAINS / name),
    )
    own = NameIndex(
        {path: file for path, file in index.files.items() if file.kind in ("domain", "device")}
    )
    assert {each.name for each in own.of_space("predicate")} == set(domain.predicates)
    assert {each.name for each in own.of_space("type")} == set(domain.types)
    assert {each.name for each in own.of_space("function")} == set(domain.functions)
    assert {each.name for each in own.of_space("object")} == set(domain.objects)
    assert {each.name: each.of for each in own.of_space("object")} == dict(domain.objects)
    assert {each.name for each in own.of_space("operator")} == {
        each.name for each in domain.operators
    }
    for each in own.of_space("predicate"):
        if each.name not in domain.quantities:
            assert each.arguments == domain.predicates[each.name].arguments


@pytest.mark.parametrize("name", DOMAINS)
def test_every_occurrence_stands_where_it_says(name: str) -> None:
    for file in index_of(BUNDLED_DOMAINS / name).files.values():
        for _, each in file.occurrences():
            if not each.ranged and not (
                isinstance(file, DeviceIndex) and "$" in file.text[each.start : each.end]
            ):
                assert file.text[each.start : each.end] == each.name


@pytest.mark.parametrize("name", DOMAINS)
def test_every_predicate_of_a_rule_or_condition_is_told_from_the_terms(name: str) -> None:
    index = index_of(BUNDLED_DOMAINS / name)
    domain = load(BUNDLED_DOMAINS / name / "domain.yaml").domain
    defined = {each.defines[0] for each in domain.asp if each.defines}
    known = {*domain.predicates, *domain.types, "object", *defined}
    for file in index.files.values():
        for piece, each in file.occurrences():
            if index.meaning(file, each, piece).space == "predicate":
                assert each.name in known, (file.path, each)


def test_a_derived_predicate_is_declared_in_yaml_and_defined_by_rules(themse: NameIndex) -> None:
    found = themse.definitions(Symbol("predicate", "accessible"))
    assert [(Path(file.path).name, each.doing) for file, each in found] == [
        ("domain.yaml", "declared"), *[("rules.lp", "defined")] * 5,
    ]  # fmt: skip


def test_a_type_that_is_read_as_a_predicate_is_the_type(themse: NameIndex) -> None:
    rules = file_of(themse, "rules.lp")
    found = themse.symbol(rules, rules.text.index("probe(P)"))
    assert found is not None
    assert found[0] == Symbol("type", "probe")


def test_variables_of_two_operators_are_not_the_same(themse: NameIndex) -> None:
    file = file_of(themse, "domain.yaml")
    found = themse.symbol(file, file.text.index("pick(Item, Place)") + 5)
    assert found is not None
    uses = [each for _, each in themse.uses(found[0])]
    entry = file.text[file.text.index("  pick(Item") : file.text.index("  put(Item")]
    assert len(uses) == entry.count("Item")


def test_variables_of_two_rules_of_one_line_are_not_the_same() -> None:
    file = FileIndex.of("rules.lp", "p(X) :- q(X). r(X) :- s(X, X).\n")
    index = NameIndex({"rules.lp": file})
    found = index.symbol(file, 2)
    assert found is not None
    assert len(list(index.uses(found[0]))) == 2


@pytest.mark.parametrize(
    ("text", "atoms", "terms"),
    [
        ("at(Item, rim), free(Place)", ["at", "free"], ["rim"]),
        ("p(X) : q(X)", ["p", "q"], []),
        ("not p(a) | q", ["p", "q"], ["a"]),
        ("2 min + 5 * weight(Tray)", [], ["weight"]),
        ("#count { T : at(T, oven) } < limit", ["at"], ["oven", "limit"]),
        ("a & b(c)", ["a", "b"], ["c"]),
        ("p(f(a), b) , q(", ["p", "q"], ["f", "a", "b"]),
    ],
)
def test_atoms_are_told_from_terms_by_their_place(
    text: str, atoms: list[str], terms: list[str]
) -> None:
    found = [each for each in mentions_in(text) if not each.variable]
    assert [each.name for each in found if each.atom] == atoms
    assert [each.name for each in found if not each.atom] == terms


@pytest.mark.parametrize("name", DOMAINS)
def test_the_pieces_of_a_sound_file_hold_all_that_the_strict_reader_reads(name: str) -> None:
    from cellwright.kb.files import File
    from cellwright.kb.loader.yaml_tree import read_tree

    for path in [
        *(BUNDLED_DOMAINS / name).glob("*.yaml"),
        *(BUNDLED_DOMAINS / name).glob("problems/*.yaml"),
    ]:
        text, found = path.read_text(), dict[str, object]()
        root, _ = read_tree(File.of(str(path), text))
        for piece in split_pieces(text):
            tree = piece_tree(piece.text)
            content = tree.plain() if tree is not None else None
            if piece.section and isinstance(content, list):
                found[piece.section] = [*(found[piece.section] or []), *content]  # type: ignore[misc]
            elif piece.section and isinstance(content, dict):
                found[piece.section] = {**(found[piece.section] or {}), **content}  # type: ignore[dict-item]
            elif isinstance(content, dict):
                found |= content
        assert found == root.plain(), path


def test_an_unfinished_line_spoils_no_other_entry() -> None:
    text = (LABORATORY / "domain.yaml").read_text()
    whole = {each.written() for each in FileIndex.of("domain.yaml", text).declared()}
    for cut in (
        "  heat(Probe, Depot",
        "    preconditions: at(Probe, Depot), posi",
        "    command: {stream: furn",
    ):
        place = text.index(cut) + len(cut)
        end = text.index("\n", place)
        broken = text[:place] + text[end:]
        left = {each.written() for each in FileIndex.of("domain.yaml", broken).declared()}
        assert len(whole - left) <= 1, cut


def test_a_range_declares_each_of_its_names() -> None:
    file = FileIndex.of("domain.yaml", "domain: d\nobjects:\n  probe: [probe_08..11]\n")
    assert [each.name for each in file.declared()] == [
        "probe_08",
        "probe_09",
        "probe_10",
        "probe_11",
    ]


def test_what_was_read_of_a_piece_moves_with_it(tmp_path: Path) -> None:
    shutil.copytree(LABORATORY, tmp_path / "themse")
    text = (tmp_path / "themse" / "domain.yaml").read_text()
    before = [each for _, each in FileIndex.of("domain.yaml", text).occurrences()]
    after = [each for _, each in FileIndex.of("domain.yaml", f"# moved\n{text}").occurrences()]
    assert [each.moved(8) for each in before] == after


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\n",
        "# only a comment\n",
        "objects:\n",
        "  - x\n",
        "objects:\n\n# end\ntypes:",
        "-",
        ":",
    ],
)
def test_a_text_with_little_in_it_has_pieces(text: str) -> None:
    assert "".join(each.text for each in split_pieces(text)) in text
    assert list(FileIndex.of("domain.yaml", text).declared()) == []

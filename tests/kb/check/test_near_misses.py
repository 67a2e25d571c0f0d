"""What is almost a convention is pointed at; what is one, or something else, is not."""

from pathlib import Path

import pytest

from cellwright.kb.check.near_misses import near_misses
from cellwright.kb.loader import load_domain
from cellwright.kb.model.name_conventions import CONVENTION_BY_NAME, Conventions, Sort
from tests.places import BUNDLED, TOP

SECTIONS = {Sort.STATIC: "statics", Sort.FLUENT: "fluents"}
NAMES = [role for role, each in CONVENTION_BY_NAME.items() if each.sort is not Sort.CONSTANT]
PREDICATES = [role for role in NAMES if CONVENTION_BY_NAME[role].sort in SECTIONS]
OTHERS = [
    *sorted((TOP / "tests" / "domains").glob("*/domain.yaml")),
    *sorted((TOP / "tests" / "engine").rglob("domain.yaml")),
    *sorted(BUNDLED.glob("*/domain.yaml")),
    TOP / "engine" / "authoring" / "starter" / "cell" / "domain.yaml",
]


def declared(
    folder: Path, names: dict[str, str] | None = None, more: dict[str, str] | None = None
) -> Path:
    """A domain that declares every convention: some under other `names`, some with `more` in
    their brackets.
    """
    names, more = names or {}, more or {}
    lines = {Sort.STATIC: ["statics:"], Sort.FLUENT: ["fluents:"]}
    for role in PREDICATES:
        each = CONVENTION_BY_NAME[role]
        arguments = ", ".join([*each.arguments, *([more[role]] if role in more else [])])
        lines[each.sort].append(f"  {names.get(role, role)}({arguments}): {{}}")
    type_, function = names.get("measurement", "measurement"), names.get("meas", "meas")
    text = (
        "domain: all\ntypes:\n  measurement: object\n  tool: object\n  arm: object\n  place: "
        "term\n  station: object\n"
    )
    text += "  kind: [thickness, profile]\nfunctions:\n  FUNCTION(measurement): place\n"
    text += "\n".join(line for section in lines.values() for line in section) + "\n"
    text = text.replace("measurement", type_).replace("FUNCTION", function)
    (folder / "domain.yaml").write_text(text)
    return folder / "domain.yaml"


def test_fields_are_called_as_their_roles_and_named_so_at_first() -> None:
    assert all(
        role == each.role == getattr(Conventions(), role)
        for role, each in CONVENTION_BY_NAME.items()
    )


def test_conventions_are_no_near_misses_of_each_other(tmp_path: Path) -> None:
    assert near_misses(load_domain(str(declared(tmp_path)))) == []


@pytest.mark.parametrize("role", NAMES)
def test_a_letter_that_is_missing_is_noticed(tmp_path: Path, role: str) -> None:
    misspelt = role[:1] + role[2:]
    (found,) = near_misses(load_domain(str(declared(tmp_path, {role: misspelt}))))
    assert (found.code, found.warning) == ("K311", True)
    assert f"'{misspelt}' is almost '{role}'" in found.message
    assert f"`conventions: {{{role}: {misspelt}}}`" in found.hint


@pytest.mark.parametrize("role", NAMES)
def test_a_name_that_the_domain_says_is_meant_is_none(tmp_path: Path, role: str) -> None:
    misspelt = role[:1] + role[2:]
    file = declared(tmp_path, {role: misspelt})
    file.write_text(f"{file.read_text()}conventions:\n  {role}: {misspelt}\n")
    domain = load_domain(str(file))
    assert near_misses(domain) == []
    assert getattr(domain.conventions, role) == misspelt


@pytest.mark.parametrize("role", PREDICATES)
def test_an_argument_too_many_is_noticed(tmp_path: Path, role: str) -> None:
    (found,) = near_misses(load_domain(str(declared(tmp_path, more={role: "int"}))))
    assert f"the engine does not read this '{role}'" in found.message
    assert CONVENTION_BY_NAME[role].written() in found.hint


@pytest.mark.parametrize(
    "file", OTHERS, ids=lambda file: f"{file.parent.parent.name}/{file.parent.name}"
)
def test_other_domains_have_no_near_misses(file: Path, tmp_path: Path) -> None:
    for each in file.parent.glob("*.*"):
        (tmp_path / each.name).write_bytes(each.read_bytes().replace(b"CELL", b"cell"))
    assert near_misses(load_domain(str(tmp_path / "domain.yaml"))) == []


@pytest.mark.parametrize(
    "declaration",
    [
        "fluents:\n  position(place, place): {}",
        "statics:\n  position(place, place): {}\n  normal(place): {}\n  needs(place, place): "
        "{}\n  change(place): {}",
        "statics:\n  travel(place, place): {}",
        "statics:\n  release(place): {}\n  priority(place): {}",
        "statics:\n  positons(place, int, int, int): {}\n  chosn(place, place): {}",
        "fluents:\n  travels(place, place, time): {}",
    ],
)
def test_a_name_that_means_something_else_is_left_alone(declaration: str, tmp_path: Path) -> None:
    (tmp_path / "domain.yaml").write_text(
        f"domain: other\ntypes:\n  place: object\n{declaration}\n"
    )
    assert near_misses(load_domain(str(tmp_path))) == []


def said(folder: Path, *declarations: str) -> list[str]:
    """What is pointed at in a domain of one type, in which each declaration is `section:
    predicate`.
    """
    sections: dict[str, list[str]] = {}
    for each in declarations:
        section, predicate = each.split(": ")
        sections.setdefault(section, []).append(f"  {predicate}: {{}}")
    text = "\n".join(line for section in sections for line in (f"{section}:", *sections[section]))
    (folder / "domain.yaml").write_text(f"domain: other\ntypes:\n  thing: object\n{text}\n")
    return [each.message for each in near_misses(load_domain(str(folder / "domain.yaml")))]


PLACED = ("statics: position(thing, int, int, int)", "statics: normal(thing, int, int, int)")
THREE = (*PLACED, "statics: tolerance(thing, int)")


def test_a_domain_measures_from_three_conventions_on(tmp_path: Path) -> None:
    assert said(tmp_path, *PLACED, "statics: bor(thing, int)") == []
    (found,) = said(tmp_path, *THREE, "statics: bor(thing, int)")
    assert found.startswith("'bor' is almost 'bore'")


@pytest.mark.parametrize(
    ("declaration", "meant"),
    [
        ("fluents: chosen(thing, thing)", True),
        ("statics: chosen(thing)", True),
        ("fluents: chosen(thing)", False),  # another sort and another count: another thing
        ("fluents: thickness", False),  # constants are left out
        ("fluents: release(thing, time)", True),
        ("statics: release(thing)", False),  # nothing in the domain is about time
    ],
)
def test_a_declaration_of_a_known_name_is_meant_if_it_is_like_the_convention(
    tmp_path: Path, declaration: str, meant: bool
) -> None:
    found = said(tmp_path, *THREE, declaration)
    assert len(found) == meant
    assert all("the engine does not read this" in each for each in found)


def test_where_one_convention_is_about_time_others_are_meant_so(tmp_path: Path) -> None:
    travel = "statics: travel(thing, thing, time)"
    assert said(tmp_path, travel) == []
    (found,) = said(tmp_path, travel, "statics: release(thing)")
    assert "the engine does not read this 'release'" in found

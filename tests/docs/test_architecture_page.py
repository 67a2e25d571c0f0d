"""The page on the architecture says what the import contracts say, and names what is there."""

import re
import tomllib

from tests.places import TOP

PAGE = (TOP / "docs" / "architecture.md").read_text("utf-8")
CONTRACTS = tomllib.loads((TOP / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"][
    "contracts"
]
ROW = re.compile(r"^\|([^|]*)\|([^|]*)\|([^|]+)\|$", re.MULTILINE)
FLOOR = re.compile(r"`(cellwright\.(?:engine|kb)\.\w+)`")


def layers(container: str) -> list[list[str]]:
    """The floors inside a package, from top to bottom, by its contract."""
    (found,) = (each["layers"] for each in CONTRACTS if each.get("containers") == [container])
    return [[f"{container}.{room}" for room in layer.split(" | ")] for layer in found]


def floors() -> dict[str, list[str]]:
    """The floors of the engine on the page, each with its rooms."""
    rows = ROW.findall(PAGE)
    return {
        name[0]: rooms.strip().split(", ")
        for floor, rooms, _ in rows
        if (name := FLOOR.findall(floor))
    }


def test_the_floors_of_the_engine_stand_in_the_order_of_the_contract() -> None:
    assert [[floor] for floor in floors()] == layers("cellwright.engine")


def test_each_floor_has_the_rooms_that_its_contract_lists() -> None:
    listed = {floor: rooms for floor, rooms in floors().items() if rooms != [""]}
    assert listed
    for floor, rooms in listed.items():
        contract = {room for layer in layers(floor) for room in layer}
        assert {f"{floor}.{room}" for room in rooms} == contract


def test_the_floors_of_the_knowledge_base_stand_in_the_order_of_the_contract() -> None:
    below = PAGE[PAGE.index("Below them stands") :]
    rows = re.findall(r"^\| ((?:`cellwright\.kb\.\w+`(?:, )?)+) \|", below, re.MULTILINE)
    assert [sorted(FLOOR.findall(row)) for row in rows] == [
        sorted(layer) for layer in layers("cellwright.kb")
    ]


def test_layer_contracts_are_exhaustive() -> None:
    inside = [each for each in CONTRACTS if each.get("containers")]
    assert inside
    assert all(each.get("exhaustive") for each in inside)


def test_every_folder_of_the_engine_is_a_floor() -> None:
    parts = (path for path in (TOP / "engine").iterdir() if not path.name.startswith(("_", "py.")))
    assert {f"cellwright.engine.{path.stem}" for path in parts} == set(floors())


def test_what_the_page_names_is_there() -> None:
    dotted = re.findall(r"`cellwright\.((?:engine|kb)(?:\.\w+)+)`", PAGE)
    folders = re.findall(r"`((?:engine|kb|tests|docs)(?:/[\w.]+)+)`", PAGE)
    assert dotted
    assert folders
    for name in dotted:
        path = TOP.joinpath(*name.split("."))
        inside = path.parent.with_suffix(".py")
        there = path.is_dir() or path.with_suffix(".py").is_file()
        assert there or re.search(
            rf"^(?:(?:class|def) {path.name}\b|{path.name} = )",
            inside.read_text("utf-8"),
            re.MULTILINE,
        ), name
    for name in folders:
        assert (TOP / name).exists(), name


def test_the_rooms_of_the_pipelines_stand_in_the_order_of_their_contract() -> None:
    below = PAGE[PAGE.index("The rooms of the pipelines stand on floors") :]
    rows = re.findall(r"^\| ([a-z_, ]+) \| [A-Z]", below, re.MULTILINE)
    container = "cellwright.engine.pipelines"
    assert [[f"{container}.{room}" for room in row.split(", ")] for row in rows] == [
        sorted(layer) for layer in layers(container)
    ]


def test_the_lists_of_folders_name_modules_that_are_there() -> None:
    items = re.findall(r"^- `((?:kb|engine)/[\w/]+)`(.*(?:\n  .*)*)", PAGE, re.MULTILINE)
    assert len(items) > 20
    for folder, text in items:
        inside = {path.stem for path in (TOP / folder).rglob("*")}
        named = set(re.findall(r"`(\w+)`", text))
        assert named <= inside, (folder, named - inside)

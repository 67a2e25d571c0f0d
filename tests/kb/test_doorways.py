"""Doorways of rooms: what they name at run time is what type checkers read, and each name loads."""

import ast
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import cellwright.engine
import cellwright.kb
from cellwright.kb.doorways import open_doorway

CALL = open_doorway.__name__


def doorways() -> list[str]:
    """The names of all modules that open a doorway."""
    rooms = []
    for package in (cellwright.kb, cellwright.engine):
        (root,) = package.__path__
        for file in sorted(Path(root).rglob("*.py")):
            if f"__getattr__ = {CALL}(" in file.read_text():
                parts = file.relative_to(root).with_suffix("").parts
                rooms.append(".".join((package.__name__, *parts)).removesuffix(".__init__"))
    return rooms


def typed_names(room: ModuleType) -> dict[str, str]:
    """The module of each name that type checkers read in a doorway."""
    tree = ast.parse(Path(str(room.__file__)).read_text())
    (block,) = (statement for statement in tree.body if isinstance(statement, ast.If))
    imports = [statement for statement in block.body if isinstance(statement, ast.ImportFrom)]
    return {name.name: str(line.module) for line in imports for name in line.names}


def loaded_names(room: ModuleType) -> dict[str, str]:
    """The module of each name that a doorway loads."""
    tree = ast.parse(Path(str(room.__file__)).read_text())
    (call,) = (
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == CALL
    )
    exports: dict[str, tuple[str, ...]] = ast.literal_eval(call.args[1])
    return {
        name: room.__name__ + module if module.startswith(".") else module
        for module, names in exports.items()
        for name in names
    }


EXTRAS = ("coal", "distributed", "mujoco", "nicegui", "unified_planning")


@pytest.mark.parametrize("name", doorways())
def test_a_doorway_loads_what_type_checkers_read(name: str) -> None:
    room = import_module(name)
    assert loaded_names(room) == typed_names(room)
    for exported, module in loaded_names(room).items():
        try:
            loaded = import_module(module)
        except ModuleNotFoundError as missing:
            if missing.name not in EXTRAS:
                raise
            continue
        assert getattr(room, exported) is getattr(loaded, exported)


def test_an_unknown_name_is_an_attribute_error_that_names_the_room() -> None:
    with pytest.raises(AttributeError, match="module 'hall' has no attribute 'lamp'"):
        open_doorway("hall", {"math": ("pi",)})("lamp")


def test_a_name_is_loaded_at_each_use() -> None:
    assert open_doorway("hall", {"math": ("pi", "tau")})("tau") > 6


def test_the_libraries_of_a_module_are_loaded_before_it_and_with_no_module_beside_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "large_library_here.py").write_text("ORDER = ['library']\n")
    (tmp_path / "small_room_here.py").write_text(
        "import sys\nORDER = [*sys.modules['large_library_here'].ORDER, 'room']\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    room = open_doorway(
        "here",
        {"small_room_here": ("ORDER",), "math": ("pi",)},
        libraries={"small_room_here": ("large_library_here",)},
    )
    with pytest.raises(AttributeError):
        room("name_that_nobody_exports")
    assert room("pi") > 3
    assert "large_library_here" not in sys.modules
    assert room("ORDER") == ["library", "room"]

"""The doorway of a room: a package that names what it exports and loads each module at first use.

Callers import the room at the top of their module and write `report.plan_svg(...)`. A module of the
room is loaded when one of its names is first asked for (PEP 562), so that a short command loads
only what it needs. Type checkers read the same names from the `if TYPE_CHECKING` block above; a
test holds both together.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any


def open_doorway(
    room: str,
    exports: Mapping[str, tuple[str, ...]],
    libraries: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> Callable[[str], Any]:
    """The `__getattr__` of `room`: a name out of the module in `exports` that has it.

    `exports` has the names of each module. A module that begins with a dot is one of the room.
    `libraries` has large modules that a module of the room needs. They are loaded before that
    module, because imports inside imports are slow: each adds six calls to the stack, and where a
    piece of the stack of Python 3.11 ends, each further call allocates the next piece and frees it
    again.
    """
    module_of = {name: module for module, names in exports.items() for name in names}

    def exported_name(name: str) -> Any:
        """What the room exports by this name. Raises `AttributeError` for any other name."""
        if name not in module_of:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        for library in libraries.get(module_of[name], ()):
            import_module(library)
        return getattr(import_module(module_of[name], room), name)

    return exported_name

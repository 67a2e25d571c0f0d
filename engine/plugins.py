"""Finds the implementations of the engine's ports among the installed packages' entry points.

The engine's own implementations are registered in the same way as those of other packages.
"""

from collections.abc import Callable, Iterable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from cellwright.engine.ports import ContactFilter, Driver, DriverSetup, GeometryBackend
    from cellwright.kb.model.contact_model import ContactModel

GEOMETRY_GROUP = "cellwright.geometry"
OWN_GEOMETRY = "cellwright.engine.stages.geometry.collision.builtin"
CONTACT_FILTERS = "cellwright.contact_filters"
DRIVER_GROUP = "cellwright.drivers"


def _entry_points(group: str) -> "Iterable[EntryPoint]":
    from importlib import metadata  # slow to load, and the engine's own geometry needs none

    return metadata.entry_points(group=group)


def registered_names(group: str) -> list[str]:
    """The names that are registered in a group. The packages that they need may be missing."""
    return sorted({point.name for point in _entry_points(group)})


def geometry_backend(name: str = "builtin") -> "GeometryBackend":
    """The geometry backend of this name. The engine's own is there without a search among packages,
    so that it starts quickly.

    Raises `InvalidInput` when it is unknown or its package is not installed.
    """
    own = import_module(OWN_GEOMETRY) if name == "builtin" else None
    backend: GeometryBackend = own.BuiltinBackend() if own else _load_plugin(GEOMETRY_GROUP, name)()
    return backend


def contact_filter(name: str, model: "ContactModel") -> "ContactFilter":
    """The filter of contact states of this name, made for a contact model.

    Raises `InvalidInput` as `geometry_backend` does.
    """
    contact_filter_made: ContactFilter = _load_plugin(CONTACT_FILTERS, name)(model)
    return contact_filter_made


def make_driver(name: str, setup: "DriverSetup") -> "Driver":
    """The driver of this name, made for a run. Raises `InvalidInput` as `geometry_backend` does."""
    driver_made: Driver = _load_plugin(DRIVER_GROUP, name)(setup)
    return driver_made


def _load_plugin(group: str, name: str) -> Callable[..., Any]:
    entry_points = [point for point in _entry_points(group) if point.name == name]
    if not entry_points:
        names = registered_names(group)
        again = "install this version again: none of its plug-ins of this kind is registered"
        hint = nearest_hint(name, names) or (f"one of: {', '.join(names)}" if names else again)
        raise InvalidInput(
            [Diagnostic(Source(name), "K414", f"no plug-in of this name for {group}", hint)]
        )
    try:
        factory: Callable[..., Any] = entry_points[0].load()
    except ImportError as error:
        hint = f"pip install 'cellwright[{name}]'"
        message = f"the plug-in '{name}' needs a package that is not installed: {error.name}"
        raise InvalidInput([Diagnostic(Source(name), "K414", message, hint)]) from None
    return factory

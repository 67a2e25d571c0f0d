"""Devices for people: all of them as a table, and one with its parameters, ports, own names and commands."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.rows import TextTable
from cellwright.kb.loader.uses import Device


def listed(device: Device) -> dict[str, Any]:
    """What the head of a device says, for programs."""
    return {
        "device": device.name,
        "about": device.about,
        "parameters": {
            key: {"is": each.meaning, "default": each.default} for key, each in device.parameters.items()
        },
        "own": dict(device.own),
        "needs": dict(device.needs),
        "offers": dict(device.offers),
        "drives": dict(device.drives),
        "uses": list(device.uses),
        "path": str(device.path),
    }


def listing(devices: Sequence[Device]) -> RenderableType:
    """The devices as a table."""
    rows = [(each.name, each.about, ", ".join(each.needs), ", ".join(each.offers)) for each in devices]
    return TextTable(("device", "what it is", "needs", "offers"), rows)


def page(device: Device) -> RenderableType:
    """All that somebody has to know who uses a device."""
    parameters = {
        key: f"{each.meaning}; {'no default' if each.default is None else each.default}"
        for key, each in device.parameters.items()
    }
    sections: list[tuple[str, Mapping[str, str]]] = [
        ("parameters, with their defaults", parameters),
        ("needs (ports that another device fills)", device.needs),
        ("offers (ports that it fills for others)", device.offers),
        ("own names (another use of the device has its name before them)", device.own),
        ("its driver", device.drives),
    ]
    parts: list[RenderableType] = [Text.assemble((device.name, "bold"), f": {device.about}")]
    for title, entries in sections:
        if entries:
            parts += [Text(f"\n{title}", style="bold"), TextTable(("", ""), list(entries.items()))]
    parts += [Text("\nhow to use it", style="bold"), Text(_use(device)), Text(f"\nfile: {device.path}")]
    return Group(*parts)


def _use(device: Device) -> str:
    required = [key for key, each in device.parameters.items() if each.default is None]
    given = ", ".join(f"{key}: ..." for key in required)
    optional = next((f"{k}: {v.default}" for k, v in device.parameters.items() if v.default is not None), "")
    second = ", ".join(filter(None, (f"device: {device.name}", given or optional)))
    return f"  use:\n    {device.name}: {{{given}}}\n    second_{device.name}: {{{second}}}"

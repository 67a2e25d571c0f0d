"""Devices as a table, and one with its parameters, ports, own names and commands."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.kb.loader.device_uses import DeviceHead


def device_entry(device: DeviceHead) -> dict[str, Any]:
    """What the head of a device says, for programs."""
    return {
        "device": device.name,
        "about": device.about,
        "parameters": {
            key: {"is": parameter.meaning, "default": parameter.default}
            for key, parameter in device.parameters.items()
        },
        "own": dict(device.own),
        "needs": dict(device.needs),
        "offers": dict(device.offers),
        "drives": dict(device.drives),
        "uses": list(device.uses),
        "path": str(device.path),
    }


def device_table(devices: Sequence[DeviceHead]) -> RenderableType:
    """The devices as a table."""
    rows = [
        (device.name, device.about, ", ".join(device.needs), ", ".join(device.offers))
        for device in devices
    ]
    return TextTable(("device", "what it is", "needs", "offers"), rows)


def device_page(device: DeviceHead) -> RenderableType:
    """All that somebody has to know who uses a device."""
    parameters = {
        key: f"{parameter.meaning}; "
        f"{'no default' if parameter.default is None else parameter.default}"
        for key, parameter in device.parameters.items()
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
    parts += [
        Text("\nhow to use it", style="bold"),
        Text(_use_example(device)),
        Text(f"\nfile: {device.path}"),
    ]
    return Group(*parts)


def _use_example(device: DeviceHead) -> str:
    required = [key for key, parameter in device.parameters.items() if parameter.default is None]
    required_text = ", ".join(f"{key}: ..." for key in required)
    optional = next(
        (f"{k}: {v.default}" for k, v in device.parameters.items() if v.default is not None), ""
    )
    second = ", ".join(filter(None, (f"device: {device.name}", required_text or optional)))
    return f"  use:\n    {device.name}: {{{required_text}}}\n    second_{device.name}: {{{second}}}"

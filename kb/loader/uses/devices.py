"""Devices: where they are found, and what the head of a `device.yaml` says."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.loader.quantities import child, members
from cellwright.kb.loader.reader import Findings, Reader, require, validate_shape
from cellwright.kb.loader.tree import Node, read_file
from cellwright.kb.targets import DEVICE_FILE, DEVICES, DOMAIN_FILE, bundled_devices, devices_in


@dataclass(frozen=True, slots=True)
class Parameter:
    """What a use may set: `default` is the value without it; None if each use has to give one."""

    meaning: str
    default: str | None


@dataclass(frozen=True, slots=True)
class Device:
    """The head of a device file. `offers` are ports and the names that fill them, with `$name` not filled in yet."""

    name: str
    about: str
    parameters: Mapping[str, Parameter]
    own: Mapping[str, str]
    needs: Mapping[str, str]
    offers: Mapping[str, str]
    drives: Mapping[str, str]
    example: Mapping[str, str]
    uses: Mapping[str, tuple[Node, Node]]
    folder: Path

    @property
    def path(self) -> Path:
        """Its file."""
        return self.folder / DEVICE_FILE


def available(domain: Path) -> dict[str, Path]:
    """The devices that a domain file can use, by name: those in `devices` beside it or one folder above, and bundled ones."""
    above, beside = domain.absolute().parent.parent / DEVICES, domain.parent / DEVICES
    return {**bundled_devices(), **devices_in(above), **devices_in(beside)}


def read_device(folder: Path) -> Device:
    """The head of the device in a folder. Raises `InvalidInput`."""
    findings = Findings()
    reader = Reader.of(read_file(folder / DEVICE_FILE), findings)
    if not validate_shape(reader, "device"):
        require(findings)
    name = reader.text("device")
    if name != folder.name:
        where = reader.root.descend(("device",)).where
        hint = f"call the device or its folder '{folder.name}'"
        findings.add(where, "K104", f"the device '{name}' lies in a folder of another name", hint)
    device = Device(
        name,
        reader.text("about"),
        {key: _parameter(node) for key, _, node in reader.entries("parameters")},
        _texts(reader, "own"),
        _texts(reader, "needs"),
        _texts(reader, "offers"),
        _texts(reader, "drives"),
        _texts(reader, "example"),
        {key: (place, node) for key, place, node in reader.entries("use")},
        folder,
    )
    _refuse_twice(reader, findings)
    require(findings)
    return device


def _parameter(node: Node) -> Parameter:
    default = child(node, "default")
    return Parameter(str(node.value["is"][1].value), None if default is None else text_of(default))


def _texts(reader: Reader, section: str) -> dict[str, str]:
    return {key: str(node.value) for key, _, node in reader.entries(section)}


def _refuse_twice(reader: Reader, findings: Findings) -> None:
    """Parameters, own names and ports share their names, and some names mean something else."""
    seen = {"name", "device", "prefix"}
    for section in ("parameters", "own", "needs"):
        for key, place, _ in reader.entries(section):
            if key in seen:
                hint = "parameters, own names and ports share their names; `name`, `prefix` and `device` are taken"
                findings.add(place.where, "K104", f"'{key}' is declared already", hint)
            seen.add(key)


def text_of(node: Node) -> str:
    """A value as it is filled in: a scalar as it is written, a list or mapping in brackets. Raises `InvalidInput`."""
    if isinstance(node.value, list):
        return f"[{', '.join(map(text_of, node.value))}]"
    if isinstance(node.value, dict):
        return "{" + ", ".join(f"{key}: {text_of(value)}" for key, _, value in members(node)) + "}"
    value = str(node.value)
    if not value or any(each in value for each in "\n$#:{}[]'\"&*!|>%@`"):
        hint = "write a name, a number, a time, a term, or a list of them"
        raise InvalidInput(
            [Diagnostic(node.where, "K005", f"'{value[:60]}' is no value of a parameter", hint)]
        )
    return value


def all_devices(folder: Path) -> tuple[Device, ...]:
    """The devices that a domain in a folder can use, in the order of their names. Raises `InvalidInput`."""
    return tuple(read_device(each) for _, each in sorted(available(folder / DOMAIN_FILE).items()))


def device_called(name: str, folder: Path) -> Device:
    """The device of this name that a domain in a folder can use. Raises `InvalidInput`."""
    known = available(folder / DOMAIN_FILE)
    if name not in known:
        raise InvalidInput([unknown_name("device", name, known, Source(name))])
    return read_device(known[name])

"""Which devices a domain uses, and the values of their parameters, names and ports."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.files import File, read_file
from cellwright.kb.loader.device_uses.device_files import (
    DeviceHead,
    FilledFile,
    all_values,
    available_devices,
    fill_file,
    parameter_text,
    read_device,
)
from cellwright.kb.loader.yaml_tree import YamlNode, child_at, mapping_members, read_tree

MAX_USES = 200
USE_NAME = re.compile(r"[a-z][A-Za-z0-9_]*")


@dataclass
class DeviceUse:
    """One use of a device under a name.

    `values` grow from what is given to what ports stand for.
    """

    name: str
    device: DeviceHead
    where: Source
    given: Mapping[str, YamlNode]
    bases: tuple["DeviceUse", ...]
    values: dict[str, str] = field(default_factory=dict)

    def read(self, file: str) -> FilledFile:
        """A file of the device, filled in. Raises `InvalidInput`."""
        return self.filled(read_file(self.device.folder / file))

    def filled(self, file: File) -> FilledFile:
        """A text of the device, filled in. Raises `InvalidInput`."""
        return fill_file(file, all_values(self.scope()), self.where)

    def scope(self) -> dict[str, str]:
        """All values that its files can name: its own, and those of the devices that it uses
        itself.
        """
        scope_values: dict[str, str] = {}
        for base in self.bases:
            scope_values |= {
                key: value for key, value in base.scope().items() if key not in ("name", "prefix")
            }
        return {**scope_values, **self.values}

    def example(self) -> dict[str, str]:
        """What its example says, filled in."""
        said = self.device.example.items()
        return {key: self.filled(File.of(str(self.device.path), text)).text for key, text in said}

    def offer(self, port: str) -> str:
        """The name that fills a port for others."""
        return fill_file(
            File.of("", self.device.offers[port]), tuple(self.values.items()), self.where
        ).text


@dataclass
class DeviceUses:
    """The uses of one domain, in the order in which their parts are put together: a device
    comes after those it uses.
    """

    known: Mapping[str, Path]
    section: Mapping[str, tuple[YamlNode, YamlNode]]
    found: dict[str, DeviceUse] = field(default_factory=dict)

    def add(
        self, section: Mapping[str, tuple[YamlNode, YamlNode]], path: tuple[str, ...] = ()
    ) -> list[DeviceUse]:
        """The uses in a `use` section of the domain, or of a device.

        What the domain says of a name holds for devices, too.
        """
        return [
            self._use(name, *self.section.get(name, entry), path) for name, entry in section.items()
        ]

    def _use(self, name: str, key: YamlNode, node: YamlNode, path: tuple[str, ...]) -> DeviceUse:
        called = child_at(node, "device")
        device_name = str(called.value) if called is not None else name
        given = {
            parameter: value
            for parameter, _, value in mapping_members(node)
            if parameter != "device"
        }
        if not USE_NAME.fullmatch(name):
            hint = "a name is a small letter, then letters, digits and _"
            raise InvalidInput(
                [Diagnostic(key.where, "K112", f"'{name[:60]}' is not a name", hint)]
            )
        if name in self.found:
            return self._again(name, device_name, key, given)
        if device_name not in self.known:
            raise InvalidInput(
                [unknown_name("device", device_name, self.known, (called or key).where)]
            )
        if device_name in path:
            message = f"the device '{device_name}' uses itself"
            raise InvalidInput([Diagnostic(key.where, "K109", message, "break the circle")])
        device = read_device(self.known[device_name])
        bases = self.add(device.uses, (*path, device_name))
        use = DeviceUse(name, device, key.where, given, tuple(bases))
        use.values = _use_values(use, key, node)
        self.found[name] = use
        if len(self.found) > MAX_USES:
            raise InvalidInput(
                [Diagnostic(key.where, "K007", f"more than {MAX_USES} devices in one domain")]
            )
        return use

    def _again(
        self, name: str, device: str, key: YamlNode, given: Mapping[str, YamlNode]
    ) -> DeviceUse:
        """What is used already, by the domain or by another device.

        A device asks for it without saying anything of it.
        """
        use = self.found[name]
        if use.device.name != device or (
            given and {k: parameter_text(v) for k, v in given.items()}.items() - use.values.items()
        ):
            hint = "give one of them another name, or the parameters once, in the domain"
            message = f"'{name}' is used already, as another device or with other parameters"
            raise InvalidInput([Diagnostic(key.where, "K104", message, hint)])
        return use

    def bind(self) -> None:
        """Fill the ports: as the use says, else with what the only device offers.

        Raises `InvalidInput` with all errors.
        """
        wrong: list[Diagnostic] = []
        for use in self.found.values():
            for port in use.device.needs:
                if port not in use.values:
                    self._fill(use, port, wrong)
        for use in self.found.values():
            for port in use.device.needs:
                if port in use.values:
                    use.values |= self._partner(port, use.values[port])
        if wrong:
            raise InvalidInput(wrong)

    def _partner(self, port: str, value: str) -> dict[str, str]:
        """The names of the device that fills a port, as `PORT_NAME`: what a lid says of the
        fingers of the hand.
        """
        able = (
            use
            for use in self.found.values()
            if port in use.device.offers and use.offer(port) == value
        )
        return {
            f"{port}_{own}": use.values[own] for use in able for own in ("prefix", *use.device.own)
        }

    def _fill(self, use: DeviceUse, port: str, wrong: list[Diagnostic]) -> None:
        offers = [
            (offering.name, offering.offer(port))
            for offering in self.found.values()
            if port in offering.device.offers and offering is not use
        ]
        if len({value for _, value in offers}) == 1:
            use.values[port] = offers[0][1]
            return
        asked = f"'{use.name}' needs a {port}: {use.device.needs[port]}"
        if offers:
            message = f"{asked}; {' and '.join(name for name, _ in offers)} offer one"
            hint = f"say which: {use.name}: {{{port}: {offers[0][1]}}}"
        else:
            able = sorted(
                name for name, folder in self.known.items() if port in read_device(folder).offers
            )
            message = f"{asked}; no device offers one"
            hint = (
                f"use one of: {', '.join(able)}"
                if able
                else f"say which object it is: {port}: NAME"
            )
        wrong.append(Diagnostic(use.where, "K405", message, hint))


def uses_of(root: YamlNode, domain: Path) -> list[DeviceUse]:
    """The uses of a domain with this tree, with all values; a device comes after those it uses.

    Raises `InvalidInput`.
    """
    section = child_at(root, "use")
    if section is None or not isinstance(section.value, dict):
        return []
    uses = DeviceUses(available_devices(domain), section.value)
    uses.add(section.value)
    uses.bind()
    return list(uses.found.values())


def readable_uses(
    section: Mapping[str, tuple[YamlNode, YamlNode]], domain: Path
) -> list[DeviceUse]:
    """The uses in a `use` section that can be read, in the order of `uses_of`.

    What is wrong with one hides no other.
    """
    uses = DeviceUses(available_devices(domain), section)
    for name, entry in section.items():
        with suppress(InvalidInput):
            uses.add({name: entry})
    with suppress(InvalidInput):
        uses.bind()
    return list(uses.found.values())


def uses_in(file: File) -> list[DeviceUse]:
    """The uses of the domain with this text, as if it lay at the file's path.

    Raises `InvalidInput`.
    """
    return uses_of(read_tree(file)[0], Path(file.path))


def _use_values(use: DeviceUse, key: YamlNode, node: YamlNode) -> dict[str, str]:
    """The value of each parameter and own name of a use, as far as they are given or have one.

    Raises `InvalidInput`.
    """
    device, wrong = use.device, []
    allowed = {**device.parameters, **device.own, **device.needs}
    for name, place, _ in mapping_members(node):
        if name != "device" and name not in allowed:
            wrong.append(unknown_name(f"parameter of {device.name}", name, allowed, place.where))
    if wrong:
        raise InvalidInput(wrong)
    given = {name: parameter_text(value) for name, value in use.given.items()}
    prefix = "" if use.name == device.name else f"{use.name}_"
    values = {"name": use.name, "prefix": prefix, **{own: prefix + own for own in device.own}}
    for name, parameter in device.parameters.items():
        if parameter.default is not None:
            values[name] = parameter.default
        elif name not in given:
            message = f"'{use.name}' lacks the parameter '{name}': {parameter.meaning}"
            wrong.append(Diagnostic(key.where, "K005", message, f"add `{name}:`"))
    if wrong:
        raise InvalidInput(wrong)
    return {**values, **given}

"""Files of devices: where they are, what their heads say, and their text filled in."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.files import File, read_file
from cellwright.kb.loader.reader import LoadFindings, Reader, require_valid, validate_shape
from cellwright.kb.loader.yaml_tree import YamlNode, child_at, mapping_members
from cellwright.kb.targets import (
    DEVICE_FILE,
    DEVICES_FOLDER,
    DOMAIN_FILE,
    bundled_devices,
    devices_in,
)


@dataclass(frozen=True, slots=True)
class DeviceParameter:
    """What a use may set: `default` is the value without it; None if each use has to give one."""

    meaning: str
    default: str | None


@dataclass(frozen=True, slots=True)
class DeviceHead:
    """The head of a device file.

    `offers` are ports and the names that fill them, with `$name` not filled in yet.
    """

    name: str
    about: str
    parameters: Mapping[str, DeviceParameter]
    own: Mapping[str, str]
    needs: Mapping[str, str]
    offers: Mapping[str, str]
    drives: Mapping[str, str]
    example: Mapping[str, str]
    uses: Mapping[str, tuple[YamlNode, YamlNode]]
    folder: Path

    @property
    def path(self) -> Path:
        """Its file."""
        return self.folder / DEVICE_FILE


def available_devices(domain: Path) -> dict[str, Path]:
    """The devices that a domain file can use, by name: those in `devices` beside it or one
    folder above, and bundled ones.
    """
    above, beside = domain.absolute().parent.parent / DEVICES_FOLDER, domain.parent / DEVICES_FOLDER
    return {**bundled_devices(), **devices_in(above), **devices_in(beside)}


def read_device(folder: Path) -> DeviceHead:
    """The head of the device in a folder. Raises `InvalidInput`."""
    findings = LoadFindings()
    reader = Reader.of(read_file(folder / DEVICE_FILE), findings)
    if not validate_shape(reader, "device"):
        require_valid(findings)
    name = reader.text("device")
    if name != folder.name:
        where = reader.root.descend(("device",)).where
        hint = f"call the device or its folder '{folder.name}'"
        findings.add(where, "K104", f"the device '{name}' lies in a folder of another name", hint)
    device = DeviceHead(
        name,
        reader.text("about"),
        {key: _read_parameter(node) for key, _, node in reader.entries("parameters")},
        _section_texts(reader, "own"),
        _section_texts(reader, "needs"),
        _section_texts(reader, "offers"),
        _section_texts(reader, "drives"),
        _section_texts(reader, "example"),
        {key: (place, node) for key, place, node in reader.entries("use")},
        folder,
    )
    _refuse_twice(reader, findings)
    require_valid(findings)
    return device


def _read_parameter(node: YamlNode) -> DeviceParameter:
    default = child_at(node, "default")
    return DeviceParameter(
        str(node.value["is"][1].value), None if default is None else parameter_text(default)
    )


def _section_texts(reader: Reader, section: str) -> dict[str, str]:
    return {key: str(node.value) for key, _, node in reader.entries(section)}


def _refuse_twice(reader: Reader, findings: LoadFindings) -> None:
    """Parameters, own names and ports share their names, and some names mean something else."""
    seen = {"name", "device", "prefix"}
    for section in ("parameters", "own", "needs"):
        for key, place, _ in reader.entries(section):
            if key in seen:
                hint = (
                    "parameters, own names and ports share their names; `name`, `prefix` and "
                    "`device` are taken"
                )
                findings.add(place.where, "K104", f"'{key}' is declared already", hint)
            seen.add(key)


def parameter_text(node: YamlNode) -> str:
    """A value as it is filled in: a scalar as it is written, a list or mapping in brackets.

    Raises `InvalidInput`.
    """
    if isinstance(node.value, list):
        return f"[{', '.join(map(parameter_text, node.value))}]"
    if isinstance(node.value, dict):
        return (
            "{"
            + ", ".join(
                f"{key}: {parameter_text(value)}" for key, _, value in mapping_members(node)
            )
            + "}"
        )
    value = str(node.value)
    if not value or any(sign in value for sign in "\n$#:{}[]'\"&*!|>%@`"):
        hint = "write a name, a number, a time, a term, or a list of them"
        raise InvalidInput(
            [Diagnostic(node.where, "K005", f"'{value[:60]}' is no value of a parameter", hint)]
        )
    return value


def all_devices(folder: Path) -> tuple[DeviceHead, ...]:
    """The devices that a domain in a folder can use, in the order of their names.

    Raises `InvalidInput`.
    """
    return tuple(
        read_device(device_folder)
        for _, device_folder in sorted(available_devices(folder / DOMAIN_FILE).items())
    )


def device_called(name: str, folder: Path) -> DeviceHead:
    """The device of this name that a domain in a folder can use. Raises `InvalidInput`."""
    known = available_devices(folder / DOMAIN_FILE)
    if name not in known:
        raise InvalidInput([unknown_name("device", name, known, Source(name))])
    return read_device(known[name])


PARAMETER_TEXT = re.compile(
    r"^[ \t]*[#%][^\n]*|\$(?:([A-Za-z_][A-Za-z0-9_]*)|\{([A-Za-z_][A-Za-z0-9_]*)\}|(\$))",
    re.MULTILINE,
)  # lines that are comments stay as they are
DIGIT_WORDS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
Values = tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class FilledFile(File):
    """A file with values for its parameters.

    `cuts` are the (start, end, start as written) of each value in the text.
    """

    written: File
    cuts: tuple[tuple[int, int, int], ...]
    values: Values
    used: Source

    def at(self, index: int) -> Source:
        """The place of a character in the file as it was written, with the place of the use."""
        return replace(self.written.at(self.as_written(index)), used=self.used)

    def beside(self, path: Path) -> File:
        """Another file of the device, filled in with the same values."""
        return fill_file(read_file(path), self.values, self.used)

    def user(self) -> Source | None:
        """The place where the device is used."""
        return self.used

    def as_written(self, index: int) -> int:
        """Where a character of the text stands in the file as it was written."""
        shift = 0
        for start, end, origin in self.cuts:
            if index < start:
                break
            if index < end:
                return origin
            shift = _end_of_parameter(self.written.text, origin) - end
        return index + shift


def _end_of_parameter(text: str, start: int) -> int:
    match = PARAMETER_TEXT.match(text, start)
    return match.end() if match else start


def fill_file(file: File, values: Values, used: Source) -> FilledFile:
    """The file with these values in place of `$name` and `${name}`; `$$` is one `$`. Raises
    `InvalidInput`.
    """
    known, parts, cuts, wrong = dict(values), [], [], []
    done = length = 0
    for match in PARAMETER_TEXT.finditer(file.text):
        name = match[1] or match[2]
        if name is None and not match[3]:
            continue
        if name is not None and name not in known:
            where = replace(file.at(match.start()), used=used)
            plain = [plain_name for plain_name in known if not plain_name.endswith("_words")]
            found_none = unknown_name(
                "parameter", name, plain if not name.endswith("_words") else known, where
            )
            advice = (
                f"{found_none.hint}; or declare it, under `own` for a name of the device, or "
                "under `parameters`"
            )
            wrong.append(replace(found_none, hint=advice))
        value = "$" if name is None else known.get(name, name)
        parts += [file.text[done : match.start()], value]
        length += match.start() - done
        cuts.append((length, length + len(value), match.start()))
        length, done = length + len(value), match.end()
    if wrong:
        raise InvalidInput(wrong)
    text = "".join([*parts, file.text[done:]])
    starts = File.of(file.path, text).line_starts
    return FilledFile(file.path, text, starts, file, tuple(cuts), values, used)


def all_values(values: Mapping[str, str]) -> Values:
    """The values, and for each name `NAME_words`: how people say it, with blanks for
    underscores and words for digits.
    """
    worded = {
        f"{key}_words": _spoken_name(value) for key, value in values.items() if _is_name(value)
    }
    return tuple({**worded, **values}.items())


def _spoken_name(name: str) -> str:
    return " ".join(
        re.sub(r"\d", lambda digit: f" {DIGIT_WORDS[int(digit[0])]} ", name)
        .replace("_", " ")
        .split()
    )


def _is_name(value: str) -> bool:
    return re.fullmatch(r"[a-z][A-Za-z0-9_]*", value) is not None

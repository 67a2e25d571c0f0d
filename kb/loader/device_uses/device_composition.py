"""Composes one tree of a domain's own entries and those of its devices, faults too."""

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, nearest_hint
from cellwright.kb.files import is_file, read_file
from cellwright.kb.loader.device_uses.use_binding import DeviceUse, uses_of
from cellwright.kb.loader.reader import LoadFindings, Reader
from cellwright.kb.loader.yaml_tree import YamlNode, child_at, read_tree
from cellwright.kb.targets import DEVICE_FILE

UNION_LISTS = ("include",)  # lists of names that mean different things in different files


def merge_trees(parts: Sequence[YamlNode], own: YamlNode) -> YamlNode:
    """The mappings as one, which takes its place from `own`.

    Raises `InvalidInput` where two parts contradict each other.
    """
    wrong: list[Diagnostic] = []
    whole: dict[str, tuple[YamlNode, YamlNode]] = {}
    for part in parts:
        if isinstance(part.value, dict):
            for key, entry in part.value.items():
                whole[key] = (
                    _join_entries(whole[key], entry, wrong, ())
                    if key in whole
                    else _copy_entry(entry)
                )
    if wrong:
        raise InvalidInput(wrong)
    return own._replace(value=whole)


Entry = tuple[YamlNode, YamlNode]


def _copy_entry(entry: Entry) -> Entry:
    """An entry whose mapping may be changed: trees of files are remembered, and never changed."""
    key, node = entry
    return key, node._replace(value=dict(node.value)) if isinstance(node.value, dict) else node


def _join_entries(old: Entry, new: Entry, wrong: list[Diagnostic], above: tuple[str, ...]) -> Entry:
    """Two entries with the same key, below the keys `above`. What says nothing gives way."""
    (key, first), (new_key, second) = old, new
    path = (*above, str(key.value))
    match first.value, second.value:
        case dict(), dict():
            whole: dict[str, Any] = dict(first.value)
            for name, entry in second.value.items():
                whole[name] = (
                    _join_entries(whole[name], entry, wrong, path) if name in whole else entry
                )
            return new_key, second._replace(value=whole)
        case list(), list():
            return new_key, second._replace(
                value=_join_lists(first.value, second.value, str(key.value))
            )
        case _, "":
            return old
        case "", _:
            return new
    if first.plain() != second.plain():
        place = f"{first.where.path}:{first.where.line}"
        message = f"'{key.value}' is said otherwise in {place}"
        wrong.append(Diagnostic(new_key.where, "K104", message, _suggest_remedy(path, new_key)))
    return new


def _suggest_remedy(path: tuple[str, ...], key: YamlNode) -> str:
    """What to try where two parts contradict each other: an operator of a device can be
    replaced by one of the domain.
    """
    if path[0] == "operators" and key.file.user() is None:
        name = path[1].partition("(")[0]
        return f"give it another name, or have it replace that of the device: `without: [{name}]`"
    return "say it in one place, or give one of them another name"


def _join_lists(first: list[YamlNode], second: list[YamlNode], key: str) -> list[YamlNode]:
    if key in UNION_LISTS:
        return [*first, *second]
    texts = {str(item.plain()) for item in first}
    return [*first, *(item for item in second if str(item.plain()) not in texts)]


FAULT_SECTIONS = ("exceptions", "causes", "tests", "repairs")
CAUSE_REFERENCES = {
    "exceptions": ("causes",),
    "tests": ("gives",),
    "repairs": ("cures",),
}  # where causes are named


def prefix_faults(part: YamlNode, name: str) -> YamlNode:
    """The part of a fault base with `name_` before each of its own entries, and the name behind
    what they say.
    """
    own = {section: _own_entries(part, section) for section in FAULT_SECTIONS}
    whole = dict(part.value)
    for section in FAULT_SECTIONS:
        if section in whole:
            key, node = whole[section]
            whole[section] = key, _prefix_section(section, node, own, name)
    return part._replace(value=whole)


def in_milliseconds(part: YamlNode) -> YamlNode:
    """The part of a fault base with its costs and durations, which devices tell in seconds, in
    milliseconds.
    """
    whole = dict(part.value)
    for section in ("tests", "repairs"):
        if section in whole and isinstance(whole[section][1].value, dict):
            key, node = whole[section]
            entries = {
                name: (place, _scale_costs(entry)) for name, (place, entry) in node.value.items()
            }
            whole[section] = key, node._replace(value=entries)
    return part._replace(value=whole)


def _scale_costs(node: YamlNode) -> YamlNode:
    if not isinstance(node.value, dict):
        return node
    value = dict(node.value)
    for name in ("cost", "duration"):
        if name in value and str(value[name][1].value).isdecimal():
            key, number = value[name]
            value[name] = key, number._replace(value=str(int(number.value) * 1000))
    return node._replace(value=value)


def without_operators(whole: YamlNode, gone: set[str]) -> YamlNode:
    """The fault base without what devices say of operators that are gone: their exceptions, and
    what they carry out.
    """
    kept = dict(whole.value)
    for section in FAULT_SECTIONS if gone else ():
        if section in kept and isinstance(kept[section][1].value, dict):
            key, node = kept[section]
            possible = {
                name: entry for name, entry in node.value.items() if _is_possible(entry[1], gone)
            }
            entries = {
                name: (place, _drop_operators(entry, gone))
                for name, (place, entry) in possible.items()
            }
            kept[section] = key, node._replace(value=entries)
    return whole._replace(value=kept)


def _is_possible(node: YamlNode, gone: set[str]) -> bool:
    """Whether an entry can still be: it is the domain's own, or its operator is there."""
    named_operators = (
        [child_at(node, key) for key in ("of", "by")] if node.file.user() is not None else []
    )
    return not any(
        operator is not None and _operator_name(operator) in gone for operator in named_operators
    )


def _drop_operators(node: YamlNode, gone: set[str]) -> YamlNode:
    """An entry of a device whose lists name no operator that is gone."""
    value = (
        dict(node.value) if isinstance(node.value, dict) and node.file.user() is not None else {}
    )
    for key in ("blocks", "since"):
        if key in value and isinstance(value[key][1].value, list):
            place, named = value[key]
            kept = [operator for operator in named.value if _operator_name(operator) not in gone]
            value[key] = place, named._replace(value=kept)
    return node._replace(value=value) if value else node


def _operator_name(node: YamlNode) -> str:
    return str(node.value).partition("(")[0]


def without_strangers(whole: YamlNode) -> YamlNode:
    """The fault base without what a device says for others that are not there.

    These are entries that only add to what nobody says, and shared entries to which nobody has
    added a cause.
    """
    kept = dict(whole.value)
    for section, (reference,) in CAUSE_REFERENCES.items():
        if section in kept and isinstance(kept[section][1].value, dict):
            key, node = kept[section]
            entries = {
                k: entry for k, entry in node.value.items() if _is_whole(entry[1], reference)
            }
            kept[section] = key, node._replace(value=entries)
    return whole._replace(value=kept)


def _is_whole(node: YamlNode, reference: str) -> bool:
    if not isinstance(node.value, dict) or node.file.user() is None:
        return True  # the domain's own entry
    named = child_at(node, reference)
    return "say" in node.value and (named is None or bool(named.value))


def _own_entries(part: YamlNode, section: str) -> set[str]:
    node = child_at(part, section)
    entries = node.value.items() if node is not None and isinstance(node.value, dict) else ()
    return {key for key, (_, entry) in entries if child_at(entry, "say") is not None}


def _prefix_section(section: str, node: YamlNode, own: dict[str, set[str]], name: str) -> YamlNode:
    if not isinstance(node.value, dict):
        return node
    mine = _prefix_function(own[section], name)
    causes = _prefix_function(own["causes"], name)
    entries = {}
    for key, (place, entry) in node.value.items():
        renamed_entry = _tell_name(entry, name) if key in own[section] else entry
        for reference in CAUSE_REFERENCES.get(section, ()):
            renamed_entry = _prefix_references(renamed_entry, reference, causes)
        entries[mine(key)] = (place, renamed_entry)
    return node._replace(value=entries)


def _prefix_function(own: set[str], name: str) -> Callable[[str], str]:
    return lambda key: f"{name}_{key}" if key in own else key


def _tell_name(node: YamlNode, name: str) -> YamlNode:
    key, sentence = node.value["say"]
    return node._replace(
        value={**node.value, "say": (key, sentence._replace(value=f"{sentence.value} ({name})"))}
    )


def _prefix_references(node: YamlNode, reference: str, causes: Callable[[str], str]) -> YamlNode:
    if not isinstance(node.value, dict) or reference not in node.value:
        return node
    key, named = node.value[reference]
    if isinstance(named.value, dict):
        named = named._replace(value={causes(cause): entry for cause, entry in named.value.items()})
    elif isinstance(named.value, list):
        named = named._replace(
            value=[cause._replace(value=causes(str(cause.value))) for cause in named.value]
        )
    return node._replace(value={**node.value, reference: (key, named)})


DEVICE_HEAD_KEYS = (
    "device",
    "about",
    "parameters",
    "own",
    "needs",
    "offers",
    "drives",
    "example",
    "use",
    "without",
    "tools",
)


def compose_devices(reader: Reader, path: Path) -> None:
    """Put the devices that a domain file uses into the tree that is read.

    Errors are raised as `InvalidInput`.
    """
    uses = uses_of(reader.root, path)
    if not uses:
        return
    parts = [_device_tree(use, DEVICE_FILE, reader.findings) for use in uses]
    parts = _leave_out(
        [_without_keys(part, DEVICE_HEAD_KEYS) for part in parts], child_at(reader.root, "without")
    )
    whole = merge_trees([*parts, reader.root], reader.root)
    # the first that is not denied holds
    _order_entries(whole, [reader.root, *reversed(parts)], "defaults")
    # an earlier phrase takes precedence
    _order_entries(whole, [reader.root, *parts], "commands", "phrases")
    _heaviest_first(whole)
    reader.root = whole


def composed_beside(reader: Reader, domain: Path, form: str) -> None:
    """Put what devices say in their `FORM.yaml` into the tree of the file of that form beside a
    domain file.
    """
    root = read_tree(read_file(domain))[0] if is_file(domain) else None
    uses = uses_of(root, domain) if root is not None else []
    finely = (
        form == "faults"
        and (unit := child_at(child_at(root, "units"), "time")) is not None
        and unit.value == "ms"
    )
    name = f"{form}.yaml"
    parts = [
        _prepare_part(use, _device_tree(use, name, reader.findings), form)
        for use in uses
        if is_file(use.device.folder / name)
    ]
    parts = [in_milliseconds(part) for part in parts] if finely else parts
    if parts:
        whole = merge_trees([*parts, reader.root], reader.root)
        _order_entries(
            whole, [reader.root, *reversed(parts)], "locations"
        )  # the first that fits a fact counts
        known = whole if root is None else without_operators(whole, _left_out(root))
        reader.root = without_strangers(known) if form == "faults" else whole


def _prepare_part(use: DeviceUse, part: YamlNode, form: str) -> YamlNode:
    part = _without_keys(part, (form, "units"))
    return (
        prefix_faults(part, use.name) if form == "faults" and use.name != use.device.name else part
    )


def _device_tree(use: DeviceUse, name: str, findings: LoadFindings) -> YamlNode:
    root, diagnostics = read_tree(use.read(name))
    for diagnostic in diagnostics:
        findings.note(diagnostic)
    if not isinstance(root.value, dict):
        raise InvalidInput(
            [
                Diagnostic(
                    root.where, "K005", "a file of a device is a mapping", "begin with `device:`"
                )
            ]
        )
    return root


def _without_keys(part: YamlNode, keys: Iterable[str]) -> YamlNode:
    return part._replace(value={key: entry for key, entry in part.value.items() if key not in keys})


def _order_entries(whole: YamlNode, parts: list[YamlNode], *path: str) -> None:
    """Order the entries of a section as the parts are ordered."""
    *above, section = path
    holder = whole
    for key in above:
        if (inner := child_at(holder, key)) is None:
            return
        copied = inner._replace(value=dict(inner.value))
        holder.value[key] = (holder.value[key][0], copied)
        holder = copied
    if section not in holder.value:
        return
    key, node = holder.value[section]
    sections = [
        section_node.value for part in parts if (section_node := _node_at(part, path)) is not None
    ]
    if isinstance(node.value, dict):
        names = dict.fromkeys(name for entries in sections for name in entries)
        node = node._replace(value={name: node.value[name] for name in names})
    elif isinstance(node.value, list):
        items: dict[str, YamlNode] = {}
        for item in (item for entries in sections for item in entries):
            items.setdefault(str(item.plain()), item)
        node = node._replace(value=list(items.values()))
    holder.value[section] = (key, node)


def _node_at(part: YamlNode, path: tuple[str, ...]) -> YamlNode | None:
    node: YamlNode | None = part
    for key in path:
        node = child_at(node, key)
    return node


def _heaviest_first(whole: YamlNode) -> None:
    """Order the fluents by weight, so that it does not matter which device declares which."""
    fluents = child_at(whole, "fluents")
    if fluents is not None and isinstance(fluents.value, dict):
        entries = sorted(fluents.value.items(), key=lambda entry: -_fluent_weight(entry[1][1]))
        whole.value["fluents"] = (whole.value["fluents"][0], fluents._replace(value=dict(entries)))


def _fluent_weight(node: YamlNode) -> int:
    weight = child_at(node, "weight")
    return (
        int(weight.value)
        if weight is not None and re.fullmatch(r"\d{1,9}", str(weight.value))
        else -1
    )


def _leave_out(parts: list[YamlNode], unwanted: YamlNode | None) -> list[YamlNode]:
    """The parts of devices without the operators that the domain does not want.

    Raises `InvalidInput` if there is no such operator.
    """
    if unwanted is None or not isinstance(unwanted.value, list):
        return parts
    operator_names = {name for part in parts for name in _operator_headers(part)}
    for item in unwanted.value:
        if str(item.value) not in operator_names:
            hint = nearest_hint(str(item.value), operator_names) or "name an operator of a device"
            raise InvalidInput(
                [Diagnostic(item.where, "K101", f"unknown operator '{item.value}'", hint)]
            )
    gone = {str(item.value) for item in unwanted.value}
    return [_without_operators(part, gone) for part in parts]


def _without_operators(part: YamlNode, gone: set[str]) -> YamlNode:
    operators = child_at(part, "operators")
    if operators is None or not isinstance(operators.value, dict):
        return part
    kept = _without_keys(
        operators, [header for name, header in _operator_headers(part).items() if name in gone]
    )
    return part._replace(value={**part.value, "operators": (part.value["operators"][0], kept)})


def _operator_headers(part: YamlNode) -> dict[str, str]:
    """The header of each operator of a part, by its name."""
    operators = child_at(part, "operators")
    if operators is None or not isinstance(operators.value, dict):
        return {}
    return {str(header).partition("(")[0]: header for header in operators.value}


def _left_out(root: YamlNode) -> set[str]:
    """The operators of devices that a domain leaves out, and does not replace by its own."""
    unwanted = child_at(root, "without")
    if unwanted is None or not isinstance(unwanted.value, list):
        return set()
    return {str(item.value) for item in unwanted.value} - set(_operator_headers(root))

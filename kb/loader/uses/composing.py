"""One tree of what a domain says itself and what its devices say. The nodes keep their files, so readers need not know."""

import re
from collections.abc import Iterable
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, nearest
from cellwright.kb.files import is_file
from cellwright.kb.loader.node import Node
from cellwright.kb.loader.quantities import child
from cellwright.kb.loader.reader import Findings, Reader
from cellwright.kb.loader.tree import read_file, read_tree
from cellwright.kb.loader.uses.binding import Use, uses_of
from cellwright.kb.loader.uses.faults import in_milliseconds, renamed, without_operators, without_strangers
from cellwright.kb.loader.uses.merging import merged
from cellwright.kb.targets import DEVICE_FILE

HEAD = (
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


def composed(reader: Reader, path: Path) -> None:
    """Put the devices that a domain file uses into the tree that is read. Errors are raised as `InvalidInput`."""
    uses = uses_of(reader.root, path)
    if not uses:
        return
    parts = [_tree(use, DEVICE_FILE, reader.findings) for use in uses]
    parts = _leave_out([_without(part, HEAD) for part in parts], child(reader.root, "without"))
    whole = merged([*parts, reader.root], reader.root)
    _ordered(whole, [reader.root, *reversed(parts)], "defaults")  # the first that is not denied holds
    _ordered(whole, [reader.root, *parts], "commands", "phrases")  # an earlier phrase takes precedence
    _heaviest_first(whole)
    reader.root = whole


def composed_beside(reader: Reader, domain: Path, form: str) -> None:
    """Put what devices say in their `FORM.yaml` into the tree of the file of that form beside a domain file."""
    root = read_tree(read_file(domain))[0] if is_file(domain) else None
    uses = uses_of(root, domain) if root is not None else []
    finely = (
        form == "faults" and (unit := child(child(root, "units"), "time")) is not None and unit.value == "ms"
    )
    name = f"{form}.yaml"
    parts = [
        _prepared(use, _tree(use, name, reader.findings), form)
        for use in uses
        if is_file(use.device.folder / name)
    ]
    parts = [in_milliseconds(each) for each in parts] if finely else parts
    if parts:
        whole = merged([*parts, reader.root], reader.root)
        _ordered(whole, [reader.root, *reversed(parts)], "locations")  # the first that fits a fact counts
        known = whole if root is None else without_operators(whole, _left_out(root))
        reader.root = without_strangers(known) if form == "faults" else whole


def _prepared(use: Use, part: Node, form: str) -> Node:
    part = _without(part, (form, "units"))
    return renamed(part, use.name) if form == "faults" and use.name != use.device.name else part


def _tree(use: Use, name: str, findings: Findings) -> Node:
    root, found = read_tree(use.read(name))
    for each in found:
        findings.note(each)
    if not isinstance(root.value, dict):
        raise InvalidInput(
            [Diagnostic(root.where, "K005", "a file of a device is a mapping", "begin with `device:`")]
        )
    return root


def _without(part: Node, keys: Iterable[str]) -> Node:
    return part._replace(value={key: entry for key, entry in part.value.items() if key not in keys})


def _ordered(whole: Node, parts: list[Node], *path: str) -> None:
    """Order the entries of a section as the parts are ordered."""
    *above, section = path
    holder = whole
    for key in above:
        if (inner := child(holder, key)) is None:
            return
        copied = inner._replace(value=dict(inner.value))
        holder.value[key] = (holder.value[key][0], copied)
        holder = copied
    if section not in holder.value:
        return
    key, node = holder.value[section]
    given = [found.value for part in parts if (found := _at(part, path)) is not None]
    if isinstance(node.value, dict):
        names = dict.fromkeys(name for each in given for name in each)
        node = node._replace(value={name: node.value[name] for name in names})
    elif isinstance(node.value, list):
        items: dict[str, Node] = {}
        for item in (item for each in given for item in each):
            items.setdefault(str(item.plain()), item)
        node = node._replace(value=list(items.values()))
    holder.value[section] = (key, node)


def _at(part: Node, path: tuple[str, ...]) -> Node | None:
    found: Node | None = part
    for key in path:
        found = child(found, key)
    return found


def _heaviest_first(whole: Node) -> None:
    """Order the fluents by weight, so that it does not matter which device declares which."""
    fluents = child(whole, "fluents")
    if fluents is not None and isinstance(fluents.value, dict):
        entries = sorted(fluents.value.items(), key=lambda each: -_weight(each[1][1]))
        whole.value["fluents"] = (whole.value["fluents"][0], fluents._replace(value=dict(entries)))


def _weight(node: Node) -> int:
    weight = child(node, "weight")
    return int(weight.value) if weight is not None and re.fullmatch(r"\d{1,9}", str(weight.value)) else -1


def _leave_out(parts: list[Node], unwanted: Node | None) -> list[Node]:
    """The parts of devices without the operators that the domain does not want. Raises `InvalidInput` if there is no such operator."""
    if unwanted is None or not isinstance(unwanted.value, list):
        return parts
    known = {name for part in parts for name in _operators(part)}
    for item in unwanted.value:
        if str(item.value) not in known:
            hint = nearest(str(item.value), known) or "name an operator of a device"
            raise InvalidInput([Diagnostic(item.where, "K101", f"unknown operator '{item.value}'", hint)])
    gone = {str(item.value) for item in unwanted.value}
    return [_without_operators(part, gone) for part in parts]


def _without_operators(part: Node, gone: set[str]) -> Node:
    operators = child(part, "operators")
    if operators is None or not isinstance(operators.value, dict):
        return part
    kept = _without(operators, [header for name, header in _operators(part).items() if name in gone])
    return part._replace(value={**part.value, "operators": (part.value["operators"][0], kept)})


def _operators(part: Node) -> dict[str, str]:
    """The header of each operator of a part, by its name."""
    operators = child(part, "operators")
    if operators is None or not isinstance(operators.value, dict):
        return {}
    return {str(header).partition("(")[0]: header for header in operators.value}


def _left_out(root: Node) -> set[str]:
    """The operators of devices that a domain leaves out, and does not replace by its own."""
    unwanted = child(root, "without")
    if unwanted is None or not isinstance(unwanted.value, list):
        return set()
    return {str(item.value) for item in unwanted.value} - set(_operators(root))

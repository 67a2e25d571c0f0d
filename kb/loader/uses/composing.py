"""One tree of what a domain says itself and what its devices say. The nodes keep their files, so readers need not know."""

import re
from collections.abc import Iterable
from pathlib import Path

from kb.diagnostics import Diagnostic, InvalidInput, nearest
from kb.files import is_file
from kb.loader.node import Node
from kb.loader.quantities import child
from kb.loader.reader import Findings, Reader
from kb.loader.tree import read_file, read_tree
from kb.loader.uses.binding import Use, uses_of
from kb.loader.uses.faults import in_milliseconds, renamed, without_strangers
from kb.loader.uses.merging import merged
from kb.targets import DEVICE_FILE

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
    parts = [_without(part, HEAD) for part in parts]
    whole = merged([*parts, reader.root], reader.root)
    _ordered(whole, [reader.root, *reversed(parts)], "defaults")  # the first that is not denied holds
    _ordered(whole, [reader.root, *parts], "commands", "phrases")  # an earlier phrase takes precedence
    _heaviest_first(whole)
    _leave_out(whole)
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
        reader.root = without_strangers(whole) if form == "faults" else whole


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


def _leave_out(whole: Node) -> None:
    """Drop the operators that the domain does not want. Raises `InvalidInput` if there is no such operator."""
    operators, unwanted = child(whole, "operators"), child(whole, "without")
    if unwanted is None or not isinstance(unwanted.value, list):
        return
    headers = {key.partition("(")[0]: key for key in operators.value} if operators is not None else {}
    for item in unwanted.value:
        if operators is None or str(item.value) not in headers:
            hint = nearest(str(item.value), headers) or "name an operator of a device"
            raise InvalidInput([Diagnostic(item.where, "K101", f"unknown operator '{item.value}'", hint)])
        operators.value.pop(headers[str(item.value)], None)

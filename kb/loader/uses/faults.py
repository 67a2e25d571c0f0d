"""Faults of devices. An entry with `say` is the device's own; one without adds to the entry of another device.

The own entries of a device that is used under another name get that name in front, so that two ovens can fail one by one.
"""

from collections.abc import Callable

from cellwright.kb.loader.node import Node
from cellwright.kb.loader.quantities import child

SECTIONS = ("exceptions", "causes", "tests", "repairs")
REFERENCES = {"exceptions": ("causes",), "tests": ("gives",), "repairs": ("cures",)}  # where causes are named


def renamed(part: Node, name: str) -> Node:
    """The part of a fault base with `name_` before each of its own entries, and the name behind what they say."""
    own = {section: _own(part, section) for section in SECTIONS}
    whole = dict(part.value)
    for section in SECTIONS:
        if section in whole:
            key, node = whole[section]
            whole[section] = key, _section(section, node, own, name)
    return part._replace(value=whole)


def in_milliseconds(part: Node) -> Node:
    """The part of a fault base with its costs and durations, which devices tell in seconds, in milliseconds."""
    whole = dict(part.value)
    for section in ("tests", "repairs"):
        if section in whole and isinstance(whole[section][1].value, dict):
            key, node = whole[section]
            entries = {name: (place, _scaled(each)) for name, (place, each) in node.value.items()}
            whole[section] = key, node._replace(value=entries)
    return part._replace(value=whole)


def _scaled(node: Node) -> Node:
    if not isinstance(node.value, dict):
        return node
    value = dict(node.value)
    for name in ("cost", "duration"):
        if name in value and str(value[name][1].value).isdecimal():
            key, number = value[name]
            value[name] = key, number._replace(value=str(int(number.value) * 1000))
    return node._replace(value=value)


def without_operators(whole: Node, gone: set[str]) -> Node:
    """The fault base without what devices say of operators that are gone: their exceptions, and what they carry out."""
    kept = dict(whole.value)
    for section in SECTIONS if gone else ():
        if section in kept and isinstance(kept[section][1].value, dict):
            key, node = kept[section]
            left = {name: each for name, each in node.value.items() if _has(each[1], gone)}
            entries = {name: (place, _rid(each, gone)) for name, (place, each) in left.items()}
            kept[section] = key, node._replace(value=entries)
    return whole._replace(value=kept)


def _has(node: Node, gone: set[str]) -> bool:
    """Whether an entry can still be: it is the domain's own, or its operator is there."""
    told = [child(node, key) for key in ("of", "by")] if node.file.user() is not None else []
    return not any(each is not None and _named(each) in gone for each in told)


def _rid(node: Node, gone: set[str]) -> Node:
    """An entry of a device whose lists name no operator that is gone."""
    value = dict(node.value) if isinstance(node.value, dict) and node.file.user() is not None else {}
    for key in ("blocks", "since"):
        if key in value and isinstance(value[key][1].value, list):
            place, named = value[key]
            kept = [each for each in named.value if _named(each) not in gone]
            value[key] = place, named._replace(value=kept)
    return node._replace(value=value) if value else node


def _named(node: Node) -> str:
    return str(node.value).partition("(")[0]


def without_strangers(whole: Node) -> Node:
    """The fault base without what a device says for others that are not there.

    These are entries that only add to what nobody says, and shared entries to which nobody has added a cause.
    """
    kept = dict(whole.value)
    for section, (reference,) in REFERENCES.items():
        if section in kept and isinstance(kept[section][1].value, dict):
            key, node = kept[section]
            entries = {k: each for k, each in node.value.items() if _is_whole(each[1], reference)}
            kept[section] = key, node._replace(value=entries)
    return whole._replace(value=kept)


def _is_whole(node: Node, reference: str) -> bool:
    if not isinstance(node.value, dict) or node.file.user() is None:
        return True  # the domain's own entry
    named = child(node, reference)
    return "say" in node.value and (named is None or bool(named.value))


def _own(part: Node, section: str) -> set[str]:
    node = child(part, section)
    entries = node.value.items() if node is not None and isinstance(node.value, dict) else ()
    return {key for key, (_, each) in entries if child(each, "say") is not None}


def _section(section: str, node: Node, own: dict[str, set[str]], name: str) -> Node:
    if not isinstance(node.value, dict):
        return node
    mine = _prefixed(own[section], name)
    causes = _prefixed(own["causes"], name)
    entries = {}
    for key, (place, each) in node.value.items():
        told = _told(each, name) if key in own[section] else each
        for reference in REFERENCES.get(section, ()):
            told = _referring(told, reference, causes)
        entries[mine(key)] = (place, told)
    return node._replace(value=entries)


def _prefixed(own: set[str], name: str) -> Callable[[str], str]:
    return lambda each: f"{name}_{each}" if each in own else each


def _told(node: Node, name: str) -> Node:
    key, said = node.value["say"]
    return node._replace(value={**node.value, "say": (key, said._replace(value=f"{said.value} ({name})"))})


def _referring(node: Node, reference: str, causes: Callable[[str], str]) -> Node:
    if not isinstance(node.value, dict) or reference not in node.value:
        return node
    key, named = node.value[reference]
    if isinstance(named.value, dict):
        named = named._replace(value={causes(each): entry for each, entry in named.value.items()})
    elif isinstance(named.value, list):
        named = named._replace(value=[each._replace(value=causes(str(each.value))) for each in named.value])
    return node._replace(value={**node.value, reference: (key, named)})

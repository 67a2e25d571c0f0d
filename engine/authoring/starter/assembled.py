"""A domain that is put together from devices: it plans, runs in simulation, fails and recovers at once."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.files import File
from cellwright.kb.loader.uses import Device, Use, all_devices, uses_in
from cellwright.kb.targets import DOMAIN_FILE

STORES = (
    "plate_hotel",
    "rack",
    "drawer",
)  # where probes are at the start: the first of these that the cell has
SHELVES = ("plate_hotel", "drawer")  # nothing is worked on while it lies there, if there is another place
BENCH = "rack"
PROBES = ("probe_1", "probe_2")
TRAVEL = "include: [rules.lp]\nstatics:\n  travel(target, target, time): {}\n"
WAYS = """% How long the arm takes from place to place. With the positions of all places, leave this out: see "motion" in the
% reference of the language.
travel(A, B, 4) :- visited(A), visited(B), A != B.
"""
NAME = re.compile("[a-z][a-z0-9_]*")
ORDINALS = ("", "second_", "third_", "fourth_", "fifth_")
HEAD = """# yaml-language-server: $schema=schema/{kind}.schema.json
"""


def texts(folder: Path, name: str, devices: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """The files of a domain with these devices, by their path in the folder, and faults to try. Raises `InvalidInput`.

    A gripper and a rack are added where something needs a hand or a place for the probes.
    """
    complete = _complete(folder, _numbered(devices))
    domain = _domain(folder, name, complete)
    uses = uses_in(File.of(str(folder / DOMAIN_FILE), domain))
    stored = {
        "domain.yaml": domain,
        "faults.yaml": _faults(name),
        "problems/first.yaml": _problem(name, uses),
    }
    if "measuring" in complete:
        stored |= {"domain.yaml": domain + TRAVEL, "rules.lp": WAYS}
    return stored, [example["fault"] for use in uses if "fault" in (example := use.example())]


def _numbered(devices: Sequence[str]) -> dict[str, str]:
    """The device of each use: the second furnace is called second_furnace, unless it is named (`oven=furnace`).

    Raises `InvalidInput` if there are too many, or if two have one name.
    """
    found: dict[str, str] = {}
    for each in devices:
        name, named, device = (part.strip() for part in each.partition("="))
        if named:
            if not NAME.fullmatch(name) or name in found:
                hint = "write NAME=DEVICE with a name of its own in small letters: hotel=rack"
                raise InvalidInput(
                    [Diagnostic(Source("--with"), "K406", f"'{name}' cannot be the name", hint)]
                )
            found[name] = device
            continue
        count = sum(1 for other in found.values() if other == each)
        if count == len(ORDINALS):
            hint = "write further ones into the domain: each has a name under `use:`"
            raise InvalidInput(
                [Diagnostic(Source("--with"), "K406", f"more than {count} devices '{each}'", hint)]
            )
        found[ORDINALS[count] + each] = each
    return found


def _complete(folder: Path, uses: dict[str, str]) -> dict[str, str]:
    """The uses with what they need: a hand and a place for probes, or a rack for tools."""
    known = {each.name: each for each in all_devices(folder)}
    wrong = [
        unknown_name("device", each, known, Source("--with")) for each in uses.values() if each not in known
    ]
    if wrong:
        raise InvalidInput(wrong)
    used = {device for each in uses.values() for device in _below(each, known)}
    added = ["measuring", "tool_rack"] if "measuring" in used else []
    added += ["laser_tool"] if added and "laser_tool" not in used else []  # it finds a part that has moved
    if "holding" in used or not added:
        added += [] if any("hand" in known[each].offers for each in uses.values()) else ["gripper"]
        bare = not any(each in STORES for each in uses.values())
        added += [BENCH] if bare or _shelved(known, uses) else []
    return {**{each: each for each in added}, **uses}


def _shelved(known: Mapping[str, Device], uses: Mapping[str, str]) -> bool:
    """Whether something is worked on in a holder, and the only holders are shelves with one above the other."""
    holders = [each for each in uses.values() if "holder" in known[each].offers]
    return any("holder" in known[each].needs for each in uses.values()) and {*holders} <= {"plate_hotel"}


def _below(device: str, known: Mapping[str, Device]) -> Iterator[str]:
    """A device and all that it uses."""
    yield device
    for name in known[device].uses:
        yield from _below(name, known)


def _domain(folder: Path, name: str, uses: dict[str, str]) -> str:
    """The domain file. Where several devices could fill a port, the first one does."""
    known = {each.name: each for each in all_devices(folder)}
    lines = []
    for use, device in uses.items():
        given = [f"device: {device}"] if use != device else []
        for port in known[device].needs:
            able = [other for other, each in uses.items() if port in known[each].offers and other != use]
            able.sort(key=lambda other: uses[other] in SHELVES)
            if len(able) > 1:
                offer = known[uses[able[0]]].offers[port].lstrip("$")
                plain = able[0] == uses[able[0]]
                value = able[0] if offer == "name" else offer if plain else f"{able[0]}_{offer}"
                given.append(f"{port}: {value}")
        lines.append(f"  {use}: {{{', '.join(given)}}}\n")
    return (
        HEAD.format(kind="domain")
        + "# What each device is, and which parameters it has: `cellwright devices show NAME`.\n"
        + f"domain: {name}\nuse:\n{''.join(lines)}units: {{time: s}}\n"
    )


def _faults(name: str) -> str:
    said = "# The devices say what can go wrong. Here comes what only this cell knows.\n"
    return f"{HEAD.format(kind='faults')}{said}faults: {name}\nstop: 900                 # a person comes\n"


def _problem(name: str, uses: Sequence[Use]) -> str:
    """One probe goes through every device and back; a second one goes with it where two are needed."""
    store = next((use.name for kind in STORES for use in uses if use.device.name == kind), "")
    examples = sorted((use.example() for use in uses if use.name != store), key=_turn)
    objects = [f"probe: [{', '.join(PROBES)}]"] if store else []
    objects += _further(_said(examples, "objects"))
    homes = [f"own_depot({each}, slot({store}, {n}))" for n, each in enumerate(PROBES, 1) if store]
    return "\n".join(
        [
            f"# yaml-language-server: $schema=../schema/problem.schema.json\nproblem: first\ndomain: {name}",
            *_section("objects", [f"  {each}" for each in objects]),
            *_section("statics", _items(dict.fromkeys([*homes, *_said(examples, "static")]))),
            *_section(
                "initial",
                _items(each.replace("(P,", f"({PROBES[0]},") for each in _said(examples, "initial")),
            ),
            *_section("goals", _items(_said(examples, "goal"))),
            *_section("workflow", list(_chains(store, examples)) if store else []),
            "",
        ]
    )


def _further(said: Iterable[str]) -> list[str]:
    """Objects that examples need, `TYPE: NAME`, by type."""
    found: dict[str, list[str]] = {}
    for each in dict.fromkeys(said):
        kind, _, name = each.partition(": ")
        found.setdefault(kind, []).append(name)
    return [f"{kind}: [{', '.join(names)}]" for kind, names in found.items()]


def _turn(example: dict[str, str]) -> str:
    """When a probe comes to a device, whatever the order in which devices are named."""
    return example.get("turn", "3")


def _said(examples: Iterable[dict[str, str]], key: str) -> list[str]:
    return [each[key] for each in examples if key in each]


def _items(entries: Iterable[str]) -> list[str]:
    return [f"  - {each}" for each in entries]


def _section(name: str, lines: list[str]) -> list[str]:
    return [f"{name}:", *lines] if lines else []


def _chains(store: str, examples: Sequence[dict[str, str]]) -> Iterator[str]:
    first = _said(examples, "stage") or [f"at(P, slot({store}, 3))"]
    together = _said([each for each in examples if each.get("probes") == "2"], "stage")
    for probe, stages in zip(PROBES, (first, together), strict=True):
        yield f"  - for: {{P: [{probe}]}}\n    stages: {', '.join([*stages, 'stored(P)'])}"

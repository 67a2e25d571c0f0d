"""A new domain to start from: a small commented cell, or one put together from devices."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from cellwright.engine.authoring.testing.golden_files import accept_answer, compare_all
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.files import File
from cellwright.kb.loader.device_uses import DeviceHead, DeviceUse, all_devices, uses_in
from cellwright.kb.schema import json_schema
from cellwright.kb.targets import DOMAIN_FILE

STORE_DEVICES = (
    "plate_hotel",
    "rack",
    "drawer",
)  # where probes are at the start: the first of these that the cell has
SHELF_DEVICES = (
    "plate_hotel",
    "drawer",
)  # nothing is worked on while it lies there, if there is another place
BENCH_DEVICE = "rack"
PROBE_NAMES = ("probe_1", "probe_2")
TRAVEL_TEXT = "include: [rules.lp]\nstatics:\n  travel(target, target, time): {}\n"
TRAVEL_RULES = """% How long the arm takes from place to place. With the positions of all places, leave this out: see "motion" in the
% reference of the language.
travel(A, B, 4) :- visited(A), visited(B), A != B.
"""
DEVICE_NAME = re.compile("[a-z][a-z0-9_]*")
ORDINAL_PREFIXES = ("", "second_", "third_", "fourth_", "fifth_")
OTHER_PREFIX = "other_"
DEVICE_DOMAIN_HEAD = """# yaml-language-server: $schema=schema/{kind}.schema.json
"""


def assemble_domain(
    folder: Path, name: str, devices: Sequence[str]
) -> tuple[dict[str, str], list[str]]:
    """The files of a domain with these devices, by their path in the folder, and faults to try.
    Raises `InvalidInput`.

    A gripper and a rack are added where something needs a hand or a place for the probes.
    """
    complete = _complete_uses(folder, _number_uses(devices))
    domain = _domain_text(folder, name, complete)
    uses = uses_in(File.of(str(folder / DOMAIN_FILE), domain))
    stored = {
        "domain.yaml": domain,
        "faults.yaml": _faults_text(name),
        "problems/first.yaml": _problem_text(name, uses),
    }
    if "measuring" in complete:
        stored |= {"domain.yaml": domain + TRAVEL_TEXT, "rules.lp": TRAVEL_RULES}
    return stored, [example["fault"] for use in uses if "fault" in (example := use.example())]


def _number_uses(devices: Sequence[str]) -> dict[str, str]:
    """The device of each use: the second furnace is called second_furnace, unless it is named
    (`oven=furnace`).

    Raises `InvalidInput` if there are too many, or if two have one name.
    """
    use_devices: dict[str, str] = {}
    for device_name in devices:
        name, named, device = (part.strip() for part in device_name.partition("="))
        if named:
            if not DEVICE_NAME.fullmatch(name) or name in use_devices:
                hint = "write NAME=DEVICE with a name of its own in small letters: hotel=rack"
                raise InvalidInput(
                    [Diagnostic(Source("--with"), "K406", f"'{name}' cannot be the name", hint)]
                )
            use_devices[name] = device
            continue
        count = sum(1 for use_device in use_devices.values() if use_device == device_name)
        if count == len(ORDINAL_PREFIXES):
            hint = "write further ones into the domain: each has a name under `use:`"
            raise InvalidInput(
                [
                    Diagnostic(
                        Source("--with"), "K406", f"more than {count} devices '{device_name}'", hint
                    )
                ]
            )
        use_devices[ORDINAL_PREFIXES[count] + device_name] = device_name
    return use_devices


def _complete_uses(folder: Path, uses: dict[str, str]) -> dict[str, str]:
    """The uses with what they need: a hand and a place for probes, or a rack for tools."""
    all_known = {known_device.name: known_device for known_device in all_devices(folder)}
    wrong = [
        unknown_name("device", use_device_name, all_known, Source("--with"))
        for use_device_name in uses.values()
        if use_device_name not in all_known
    ]
    if wrong:
        raise InvalidInput(wrong)
    used = {
        device for used_device in uses.values() for device in _devices_used(used_device, all_known)
    }
    added = ["measuring", "tool_rack"] if "measuring" in used else []
    # it finds a part that has moved
    added += ["laser_tool"] if added and "laser_tool" not in used else []
    if "holding" in used or not added:
        added += (
            []
            if any("hand" in all_known[used_device].offers for used_device in uses.values())
            else ["gripper"]
        )
        bare = not any(used_device in STORE_DEVICES for used_device in uses.values())
        added += [BENCH_DEVICE] if bare or _needs_bench(all_known, uses) else []
    return _separate_uses(
        {**{added_device: added_device for added_device in added}, **uses}, all_known
    )


def _separate_uses(uses: Mapping[str, str], known: Mapping[str, DeviceHead]) -> dict[str, str]:
    """The uses, with another name for each whose operators and events are called like those of an
    earlier device: the own names of a use bear its name, unless this is the name of its device.
    """
    taken: set[str] = set()
    separate = {}
    for use, device in uses.items():
        if use == device:
            if taken & known[device].own.keys():
                use = OTHER_PREFIX + device
            taken |= known[device].own.keys()
        separate[use] = device
    return separate


def _needs_bench(known: Mapping[str, DeviceHead], uses: Mapping[str, str]) -> bool:
    """Whether something is worked on in a holder, and the only holders are shelves with one
    above the other.
    """
    holders = [
        used_device for used_device in uses.values() if "holder" in known[used_device].offers
    ]
    return any("holder" in known[used_device].needs for used_device in uses.values()) and {
        *holders
    } <= {"plate_hotel"}


def _devices_used(device: str, known: Mapping[str, DeviceHead]) -> Iterator[str]:
    """A device and all that it uses."""
    yield device
    for name in known[device].uses:
        yield from _devices_used(name, known)


def _domain_text(folder: Path, name: str, uses: dict[str, str]) -> str:
    """The domain file. Where several devices could fill a port, the first one does."""
    all_known = {known_device.name: known_device for known_device in all_devices(folder)}
    lines = []
    for use, device in uses.items():
        given = [f"device: {device}"] if use != device else []
        for port in all_known[device].needs:
            able = [
                other_use
                for other_use, other_device in uses.items()
                if port in all_known[other_device].offers and other_use != use
            ]
            able.sort(key=lambda other_use: uses[other_use] in SHELF_DEVICES)
            if len(able) > 1:
                offer = all_known[uses[able[0]]].offers[port].lstrip("$")
                plain = able[0] == uses[able[0]]
                value = able[0] if offer == "name" else offer if plain else f"{able[0]}_{offer}"
                given.append(f"{port}: {value}")
        lines.append(f"  {use}: {{{', '.join(given)}}}\n")
    return (
        DEVICE_DOMAIN_HEAD.format(kind="domain")
        + "# What each device is, and which parameters it has: `cellwright devices show NAME`.\n"
        + f"domain: {name}\nuse:\n{''.join(lines)}units: {{time: s}}\n"
    )


def _faults_text(name: str) -> str:
    fault_text = "# The devices say what can go wrong. Here comes what only this cell knows.\n"
    return (
        f"{DEVICE_DOMAIN_HEAD.format(kind='faults')}{fault_text}faults: {name}\nstop: 900       "
        "          # a person comes\n"
    )


def _problem_text(name: str, uses: Sequence[DeviceUse]) -> str:
    """One probe goes through every device and back; a second one goes with it where two are
    needed.
    """
    store = next(
        (use.name for kind in STORE_DEVICES for use in uses if use.device.name == kind), ""
    )
    examples = sorted((use.example() for use in uses if use.name != store), key=_example_order)
    objects = [f"probe: [{', '.join(PROBE_NAMES)}]"] if store else []
    objects += _object_lines(_example_values(examples, "objects"))
    homes = [
        f"own_depot({probe}, slot({store}, {n}))" for n, probe in enumerate(PROBE_NAMES, 1) if store
    ]
    return "\n".join(
        [
            "# yaml-language-server: $schema=../schema/problem.schema.json\nproblem: "
            f"first\ndomain: {name}",
            *_yaml_section("objects", [f"  {object_line}" for object_line in objects]),
            *_yaml_section(
                "statics",
                _list_items(dict.fromkeys([*homes, *_example_values(examples, "static")])),
            ),
            *_yaml_section(
                "initial",
                _list_items(
                    fact.replace("(P,", f"({PROBE_NAMES[0]},")
                    for fact in _example_values(examples, "initial")
                ),
            ),
            *_yaml_section("goals", _list_items(_example_values(examples, "goal"))),
            *_yaml_section("workflow", list(_chain_lines(store, examples)) if store else []),
            "",
        ]
    )


def _object_lines(object_texts: Iterable[str]) -> list[str]:
    """Objects that examples need, `TYPE: NAME`, by type."""
    names_by_type: dict[str, list[str]] = {}
    for object_text in dict.fromkeys(object_texts):
        kind, _, name = object_text.partition(": ")
        names_by_type.setdefault(kind, []).append(name)
    return [f"{kind}: [{', '.join(names)}]" for kind, names in names_by_type.items()]


def _example_order(example: dict[str, str]) -> str:
    """When a probe comes to a device, whatever the order in which devices are named."""
    return example.get("turn", "3")


def _example_values(examples: Iterable[dict[str, str]], key: str) -> list[str]:
    return [example[key] for example in examples if key in example]


def _list_items(entries: Iterable[str]) -> list[str]:
    return [f"  - {entry}" for entry in entries]


def _yaml_section(name: str, lines: list[str]) -> list[str]:
    return [f"{name}:", *lines] if lines else []


def _chain_lines(store: str, examples: Sequence[dict[str, str]]) -> Iterator[str]:
    first = _example_values(examples, "stage") or [f"at(P, slot({store}, 3))"]
    together = _example_values(
        [example for example in examples if example.get("probes") == "2"], "stage"
    )
    for probe, stages in zip(PROBE_NAMES, (first, together), strict=True):
        yield f"  - for: {{P: [{probe}]}}\n    stages: {', '.join([*stages, 'stored(P)'])}"


STARTER_SCHEMAS = ("domain", "problem", "faults")
CELL_FOLDER = Path(__file__).with_name("starter") / "cell"


def create_domain(folder: Path) -> list[Path]:
    """Write a new domain into a new or empty folder and return the files written.

    Raises `InvalidInput`, `OSError`.
    """
    _require_empty(folder)
    return sorted(
        [*_copy_folder(CELL_FOLDER, folder, _domain_name(folder)), *_complete_domain(folder)]
    )


def create_with(folder: Path, devices: Sequence[str]) -> tuple[list[Path], list[str]]:
    """Write a domain made of these devices into a new or empty folder. Returns its files, and
    faults to try.

    Raises `InvalidInput`, `OSError`.
    """
    _require_empty(folder)
    files, faults = assemble_domain(folder, _domain_name(folder), devices)
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, "utf-8")
    return sorted([*(folder / name for name in files), *_complete_domain(folder)]), faults


def _require_empty(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        message = "the folder is not empty, and existing files are not overwritten"
        raise InvalidInput([Diagnostic(Source(str(folder)), "K403", message, "name a new folder")])


def _complete_domain(folder: Path) -> list[Path]:
    """Write the schemas and the golden plans of a new domain."""
    written = []
    for kind in STARTER_SCHEMAS:
        written.append(folder / "schema" / f"{kind}.schema.json")
        written[-1].parent.mkdir(exist_ok=True)
        written[-1].write_text(json.dumps(json_schema(kind), indent=1) + "\n", "utf-8")
    for comparison in list(compare_all(str(folder))):
        accept_answer(comparison)
        written.append(comparison.file)
    return written


def _domain_name(folder: Path) -> str:
    """The name of the domain, made from the name of the folder."""
    name = re.sub(r"[^a-z0-9_]+", "_", folder.resolve().name.lower()).strip("_")
    return name if re.match(r"[a-z]", name) else f"cell_{name}".rstrip("_")


def _copy_folder(source: Path, target: Path, name: str) -> list[Path]:
    target.mkdir(parents=True, exist_ok=True)
    written = []
    for entry in sorted(source.iterdir()):
        if entry.is_dir():
            written += _copy_folder(entry, target / entry.name, name)
        else:
            text = re.sub(
                r"^((?:domain|faults): )CELL$",
                rf"\g<1>{name}",
                entry.read_text("utf-8"),
                flags=re.MULTILINE,
            )
            (target / entry.name).write_text(text, "utf-8")
            written.append(target / entry.name)
    return written

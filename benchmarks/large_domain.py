"""A domain of about 2,000 lines, as a large cell has it: written anew for each use, the same
for the same size.
"""

from pathlib import Path

STATIONS = 64  # gives about 2,000 lines of domain.yaml


def written(folder: Path, stations: int = STATIONS) -> Path:
    """Write a domain with its rules, and one problem, into a folder.

    Returns the file of the domain.
    """
    (folder / "problems").mkdir(parents=True, exist_ok=True)
    (folder / "domain.yaml").write_text(_domain(stations))
    (folder / "rules.lp").write_text(_rules(stations))
    (folder / "problems" / "first.yaml").write_text(_problem())
    return folder / "domain.yaml"


def _domain(stations: int) -> str:
    numbers = range(1, stations + 1)
    lines = [
        "domain: large",
        "include: [rules.lp]",
        "units: {time: s}",
        "types:",
        "  place: object",
        "  part: object",
    ]
    lines += ["  gripper: place", "  setting: [open, closed]", "  device: object"]
    lines += [f"  seat_{n}: place    # where parts lie at station {n}" for n in numbers]
    lines += ["objects:", "  part: [part_1..40]", "  gripper: [gripper]"]
    lines += [f"  seat_{n}: [seat_{n}_a, seat_{n}_b]" for n in numbers]
    lines += ["  device: [" + ", ".join(f"door_{n}" for n in numbers) + "]"]
    lines += ["statics:", "  fits(part, place): {}"]
    lines += [f"  near_{n}(seat_{n}, place): {{}}" for n in numbers]
    lines += ["derived:"] + [
        f"  open_{n}(place): {{}}    # station {n} can be reached" for n in numbers
    ]
    lines += [
        "fluents:",
        "  at(part, place): {weight: 3}",
        "  position(device, setting): {weight: 2}",
    ]
    lines += ["  free(place): {weight: 1}"]
    lines += [f"  treated_{n}(part): {{weight: 4}}" for n in numbers]
    lines += ["defaults:", "  - free(Place)", "  - position(Device, closed)", "operators:"]
    for n in numbers:
        lines += _station(n)
    lines += ["deductive_operators:"]
    lines += [
        "  - when: at(Part, Place)",
        "    denies: at(Part, Other), Other != Place; free(Place)",
    ]
    lines += ["  - when: not at(Part, Place)", "    implies: free(Place)"]
    lines += [
        "  - when: position(Device, Setting)",
        "    denies: position(Device, Other), Other != Setting",
    ]
    for n in numbers:
        lines += [f"  - when: at(Part, seat_{n}_a)", f"    denies: treated_{n}(Part)"]
    return "\n".join(lines) + "\n"


def _station(n: int) -> list[str]:
    """Four operators of a station: 27 lines."""
    return [
        f"  open_door_{n}:",
        f"    preconditions: free(gripper), position(door_{n}, closed)",
        f"    adds: position(door_{n}, open)",
        f"    resources: gripper, door_{n}",
        "    duration: 3 s",
        f"  close_door_{n}:",
        f"    preconditions: free(gripper), position(door_{n}, open)",
        f"    adds: position(door_{n}, closed)",
        f"    resources: gripper, door_{n}",
        "    duration: 3 s",
        f"  load_{n}(Part, Place):",
        f"    types: {{Place: seat_{n}}}",
        "    where: fits(Part, Place)",
        f"    preconditions: at(Part, gripper), free(Place), open_{n}(Place)",
        "    adds: at(Part, Place)",
        "    resources: gripper, Part",
        "    duration: 8 s",
        '    command: {stream: "arm(load(Part, Place))", reply: done}',
        f"  treat_{n}(Part, Place):    # takes as long as the station needs",
        f"    where: near_{n}(Place, _)",
        f"    preconditions: at(Part, Place), position(door_{n}, closed)",
        f"    adds: treated_{n}(Part)",
        "    resources: Place, Part",
        f"    duration: {n} min",
    ]


def _rules(stations: int) -> str:
    lines = ["fits(P, L) :- part(P), place(L)."]
    for n in range(1, stations + 1):
        lines += [f"% station {n}", f"near_{n}(P, Q) :- seat_{n}(P), seat_{n}(Q), P != Q."]
        lines += [f"open_{n}(P) :- seat_{n}(P), position(door_{n}, open)."]
    return "\n".join(lines) + "\n"


def _problem() -> str:
    return """problem: first
domain: large
initial:
  - at(part_1, gripper)
goals:
  - treated_1(part_1)
"""

"""Small cells whose steps last as long as they like, written into a folder."""

from pathlib import Path

OVEN = """
domain: oven
types: {{item: object, place: object}}
objects:
  item: [bread]
  place: [shelf, oven, rack]
statics:
  longest_stay(place, time): {{}}
  due(item, time): {{}}
fluents:
  at(item, place): {{}}
  warm(item): {{}}
operators:
  load(I):
    preconditions: at(I, shelf)
    adds: at(I, oven)
    deletes: at(I, shelf)
    resources: arm
    duration: {load}
  heat(I):
    preconditions: at(I, oven)
    adds: warm(I)
    resources: oven
    duration: {heat}
  unload(I):
    preconditions: at(I, oven), warm(I)
    adds: at(I, rack)
    deletes: at(I, oven)
    resources: arm
    duration: 10 s
"""

JOINING = """
domain: joining
types: {{item: object, oven: object}}
objects:
  item: [tall, small]
  oven: [wide, narrow]
statics:
  longest_stay(oven, time): {{}}
  fits(item, oven): {{}}
fluents:
  waits(item): {{}}
  inside(item, oven): {{}}
  warm(item): {{}}
  joined(item, item): {{}}
operators:
  load(I, O):
    preconditions: waits(I)
    where: fits(I, O)
    adds: inside(I, O)
    deletes: waits(I)
    resources: arm
    duration: {load}
  heat_long(I):
    preconditions: inside(I, wide)
    adds: warm(I)
    resources: wide
    duration: {long}
  heat_short(I):
    preconditions: inside(I, narrow)
    adds: warm(I)
    resources: narrow
    duration: {short}
  join(I, J):
    preconditions: inside(I, wide), inside(J, narrow), warm(I), warm(J)
    adds: joined(I, J)
    deletes: inside(I, wide), inside(J, narrow)
    resources: arm
    duration: 10 s
"""


def write_oven(
    folder: Path, stay: int, heat: str, load: str = "{from: 10 s, to: 14 s}", due: int | None = None
) -> Path:
    """One item that is heated, and must not stay in the oven for longer than `stay` seconds."""
    (folder / "domain.yaml").write_text(OVEN.format(heat=heat, load=load))
    statics = [f"longest_stay(oven, {stay})", *([] if due is None else [f"due(bread, {due})"])]
    (folder / "problem.yaml").write_text(
        f"problem: one\ndomain: domain.yaml\nstatics: {statics}\n"
        "initial: ['at(bread, shelf)']\ngoals: ['at(bread, rack)', 'warm(bread)']\n"
    )
    return folder / "problem.yaml"


def write_joining(folder: Path, load: str, long: str, short: str, stays: tuple[int, int]) -> Path:
    """Two items that are heated apart and joined while both are warm and still inside; `stays` are
    the longest stays in the wide and the narrow oven.
    """
    text = JOINING.format(load=load, long=long, short=short)
    (folder / "domain.yaml").write_text(text)
    (folder / "problem.yaml").write_text(
        "problem: pair\ndomain: domain.yaml\nstatics:\n"
        f"  - longest_stay(wide, {stays[0]})\n  - longest_stay(narrow, {stays[1]})\n"
        "  - fits(tall, wide)\n  - fits(small, narrow)\n"
        "initial: ['waits(tall)', 'waits(small)']\ngoals: ['joined(tall, small)']\n"
    )
    return folder / "problem.yaml"

"""Random road maps with costs, for tests of what is reused: a vehicle, and places some of which are
closed.
"""

from pathlib import Path
from random import Random

from cellwright.kb.loader import load
from cellwright.kb.model.planning_problem import Problem

DOMAIN = """domain: roads
types: {place: object, vehicle: object}
statics: {"road(place, place, int)": {}, "closed(place)": {}}
fluents: {"at(vehicle, place)": {}, "seen(place)": {}}
operators:
  drive(V, A, B, W):
    types: {V: vehicle, A: place, B: place, W: int}
    where: road(A, B, W), not closed(B)
    preconditions: at(V, A)
    adds: at(V, B)
    cost: W
  look(V, A): {types: {V: vehicle, A: place}, preconditions: "at(V, A)", adds: seen(A)}
deductive_operators:
  - when: at(V, P)
    denies: at(V, Q), Q != P
"""
Roads = dict[tuple[int, int], int]


def road_map(draw: Random, places: int) -> Roads:
    """A ring with chords, both ways."""
    pairs = {(place, (place + 1) % places) for place in range(places)}
    pairs |= {
        (one, other) for one, other in (draw.sample(range(places), 2) for _ in range(places // 2))
    }
    return {
        pair: cost
        for a, b in sorted(pairs)
        for cost in [draw.randint(1, 9)]
        for pair in ((a, b), (b, a))
    }


def road_problem(
    folder: Path,
    roads: Roads,
    start: int,
    goals: str,
    closed: int = -1,
    vehicles: tuple[int, ...] = (),
) -> Problem:
    """A problem on a map: v0 begins at `start`, and others where they are said to."""
    places = max(place for pair in roads for place in pair)
    facts = [f"road(p{a}, p{b}, {cost})" for (a, b), cost in sorted(roads.items())]
    facts += [f"closed(p{closed})"] if closed >= 0 else []
    begin = [f"at(v{number}, p{place})" for number, place in enumerate((start, *vehicles))]
    (folder / "domain.yaml").write_text(DOMAIN)
    file = folder / "ride.yaml"
    file.write_text(
        f"problem: ride\ndomain: roads\nobjects: {{place: [p0..{places}], vehicle: "
        f"[v0..{len(vehicles)}]}}\n"
        + "statics:\n"
        + "".join(f"  - {each}\n" for each in facts)
        + "initial:\n"
        + "".join(f"  - {each}\n" for each in begin)
        + f"goals: ['{goals}']\n"
    )
    problem = load(file).problem
    assert problem is not None
    return problem

"""What a library of MACROPs is worth where every problem is new: random cells, whose costs, ways
and obstacles change.

    python benchmarks/routes.py [--kind roads|carts|workshop ...] [--queries N] [--seed N]
        [--commands N] [--json FILE]

`roads`: a vehicle on a random map. `carts`: vehicles that carry parcels on such a map. `workshop`:
parts that machines work on in stages, with tools to be changed. Every few queries the cell changes:
the costs of some ways, a shortcut, an obstacle. Each query is planned without a library and with
one, which starts empty and learns. Time is of the processor, for the whole of a query: from the
problem that was read to the checked plan, with all that the library reads and writes. `--commands`
has some of the queries planned by `cellwright plan` too, each a process of its own. Exits with 1
when a bar is missed: reuse costs at most 1.02 of a fresh plan in the geometric mean, and 1.2 at
worst; all queries together take at most 0.7 of the time without a library.
"""

import argparse
import gc
import json
import math
import random
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cellwright.engine.model.outcome import Found, Outcome
from cellwright.engine.pipelines.planning.library_plans import plan_with_library
from cellwright.engine.pipelines.planning.plan_objective import SequenceChoice
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.loader import load

MEAN, WORST, TIME = 1.02, 1.2, 0.7
console = Console()
Row = dict[str, Any]
Query = tuple[str, str]  # text of the domain, text of the problem

ROADS = """
domain: roads
types: {place: object, vehicle: object}
statics:
  road(place, place, int): {}
  closed(place): {}
fluents:
  at(vehicle, place): {}
operators:
  drive(V, A, B, W):
    types: {V: vehicle, A: place, B: place, W: int}
    where: road(A, B, W), not closed(B)
    preconditions: at(V, A)
    adds: at(V, B)
    cost: W
deductive_operators:
  - when: at(V, P)
    denies: at(V, Q), Q != P
"""

CARTS = """
domain: carts
types: {place: object, cart: object, parcel: object}
statics:
  road(place, place, int): {}
  closed(place): {}
fluents:
  at(cart, place): {}
  lies(parcel, place): {}
  carries(cart, parcel): {}
operators:
  drive(C, A, B, W):
    types: {C: cart, A: place, B: place, W: int}
    where: road(A, B, W), not closed(B)
    preconditions: at(C, A)
    adds: at(C, B)
    cost: W
  load(C, P, A):
    types: {C: cart, P: parcel, A: place}
    preconditions: at(C, A), lies(P, A), not carries(C, _)
    adds: carries(C, P)
    cost: 1
  unload(C, P, A):
    types: {C: cart, P: parcel, A: place}
    preconditions: at(C, A), carries(C, P)
    adds: lies(P, A)
    cost: 1
deductive_operators:
  - when: at(C, P)
    denies: at(C, Q), Q != P
  - when: carries(C, P)
    denies: lies(P, _)
  - when: lies(P, _)
    denies: carries(_, P)
"""

WORKSHOP = """
domain: workshop
types: {machine: object, part: object, tool: object, state: object}
statics:
  works(machine, tool, state, state, int): {}
  changing(tool, tool, int): {}
  down(machine): {}
fluents:
  has(machine, tool): {}
  is(part, state): {}
operators:
  change(M, T, U, W):
    types: {M: machine, T: tool, U: tool, W: int}
    where: changing(T, U, W), not down(M)
    preconditions: has(M, T)
    adds: has(M, U)
    cost: W
  work(M, T, P, S, E, W):
    types: {M: machine, T: tool, P: part, S: state, E: state, W: int}
    where: works(M, T, S, E, W), not down(M)
    preconditions: has(M, T), is(P, S)
    adds: is(P, E)
    cost: W
deductive_operators:
  - when: has(M, T)
    denies: has(M, U), U != T
  - when: is(P, S)
    denies: is(P, E), E != S
"""


def _map(draw: random.Random, places: int) -> dict[tuple[int, int], int]:
    """Roads both ways between near places of a square, so that every place can be reached."""
    spots = [(draw.random(), draw.random()) for _ in range(places)]

    def far(one: int, other: int) -> float:
        return math.dist(spots[one], spots[other])

    pairs = {
        (place, near)
        for place in range(places)
        for near in sorted(range(places), key=lambda each: far(place, each))[1:4]
    }
    joined = {0}
    while len(joined) < places:
        reached = _reached(joined, pairs)
        if len(reached) == places:
            break
        rest = [each for each in range(places) if each not in reached]
        pairs.add(min(((a, b) for a in reached for b in rest), key=lambda pair: far(*pair)))
        joined = reached
    weights = {}
    for one, other in sorted(pairs):
        weights[one, other] = weights[other, one] = max(
            1, round(100 * far(one, other) * draw.uniform(1, 2))
        )
    return weights


def _reached(start: set[int], pairs: set[tuple[int, int]]) -> set[int]:
    found, waiting = set(start), list(start)
    while waiting:
        here = waiting.pop()
        for one, other in pairs:
            for a, b in ((one, other), (other, one)):
                if a == here and b not in found:
                    found.add(b)
                    waiting.append(b)
    return found


def _changed(draw: random.Random, weights: dict[tuple[int, int], int], places: int) -> set[int]:
    """Change a tenth of the costs, add a shortcut; the places that are closed now."""
    for pair in draw.sample(sorted(weights), len(weights) // 10):
        weights[pair] = max(1, round(weights[pair] * draw.uniform(0.5, 2)))
    one, other = draw.sample(range(places), 2)
    weights[one, other] = weights[other, one] = draw.randint(1, 30)
    return set(draw.sample(range(places), max(1, places // 20)))


def _cell(weights: dict[tuple[int, int], int], closed: set[int]) -> str:
    facts = [f"road(p{a}, p{b}, {w})" for (a, b), w in sorted(weights.items())]
    facts += [f"closed(p{each})" for each in sorted(closed)]
    return "".join(f"  - {each}\n" for each in facts)


def _maps(
    draw: random.Random, number: int, places: int, every: int
) -> Iterator[tuple[str, set[int], list[int]]]:
    """Facts, closed places and the places that an open one reaches, for each query; the map changes
    from time to time.
    """
    weights, closed = _map(draw, places), set[int]()
    for query in range(number):
        if query and query % every == 0:
            closed = _changed(draw, weights, places)
        pairs = {pair for pair in weights if not closed & set(pair)}
        start = draw.choice([each for each in range(places) if each not in closed])
        yield _cell(weights, closed), closed, sorted(_reached({start}, pairs))


def roads(draw: random.Random, number: int, places: int, every: int) -> Iterator[Query]:
    """From somewhere to somewhere else."""
    for facts, _, free in _maps(draw, number, places, every):
        one, other = draw.sample(free, 2)
        yield (
            ROADS,
            f"problem: query\ndomain: roads\nobjects:\n  place: [p0..{places - 1}]\n  vehicle: "
            f"[v1]\nstatics:\n{facts}"
            f"initial:\n  - at(v1, p{one})\ngoals:\n  - at(v1, p{other})\n",
        )


def carts(draw: random.Random, number: int, places: int, every: int) -> Iterator[Query]:
    """One or two parcels to be brought, by two carts."""
    for facts, _, free in _maps(draw, number, places, every):
        parcels = draw.randint(1, 2)
        spots = [draw.choice(free) for _ in range(parcels)]
        carts = [draw.choice(free) for _ in range(2)]
        start = [f"at(c{n + 1}, p{p})" for n, p in enumerate(carts)]
        start += [f"lies(b{n + 1}, p{p})" for n, p in enumerate(spots)]
        goals = [
            f"lies(b{n + 1}, p{draw.choice([f for f in free if f != p])})"
            for n, p in enumerate(spots)
        ]
        yield (
            CARTS,
            f"problem: query\ndomain: carts\nobjects:\n  place: [p0..{places - 1}]\n  cart: "
            "[c1, c2]\n"
            f"  parcel: [b1..2]\nstatics:\n{facts}initial:\n"
            + "".join(f"  - {each}\n" for each in start)
            + ("  - lies(b2, p0)\n" if parcels == 1 else "")
            + "goals:\n"
            + "".join(f"  - {each}\n" for each in goals),
        )


def workshop(draw: random.Random, number: int, states: int, every: int) -> Iterator[Query]:
    """Parts that are to be brought to another state by machines with tools."""
    machines, tools = 3, 6
    changing = {
        (t, u): draw.randint(2, 20)
        for t in range(tools)
        for u in range(tools)
        if t != u and draw.random() < 0.5
    } | {(t, (t + 1) % tools): draw.randint(2, 20) for t in range(tools)}
    works: dict[tuple[int, int, int, int], int] = {}
    for state in range(states):
        for _ in range(3):
            to = draw.choice([each for each in range(states) if each != state])
            works[draw.randrange(machines), draw.randrange(tools), state, to] = draw.randint(1, 40)
        works[0, draw.randrange(tools), state, (state + 1) % states] = draw.randint(10, 40)
    down: set[int] = set()
    for query in range(number):
        if query and query % every == 0:
            for key in draw.sample(sorted(works), len(works) // 10):
                works[key] = draw.randint(1, 40)
            a, b = draw.sample(range(states), 2)
            works[draw.randrange(machines), draw.randrange(tools), a, b] = draw.randint(1, 5)
            down = {draw.randint(1, machines - 1)} if draw.random() < 0.7 else set()
        facts = [f"works(m{m}, t{t}, s{a}, s{b}, {w})" for (m, t, a, b), w in sorted(works.items())]
        facts += [f"changing(t{t}, t{u}, {w})" for (t, u), w in sorted(changing.items())]
        facts += [f"down(m{each})" for each in sorted(down)]
        parts = draw.randint(1, 2)
        begin = [draw.randrange(states) for _ in range(2)]
        start = [f"has(m{m}, t{draw.randrange(tools)})" for m in range(machines)]
        start += [f"is(x{n}, s{s})" for n, s in enumerate(begin)]
        goals = [
            f"is(x{n}, s{draw.choice([s for s in range(states) if s != begin[n]])})"
            for n in range(parts)
        ]
        yield (
            WORKSHOP,
            f"problem: query\ndomain: workshop\nobjects:\n  machine: [m0..{machines - 1}]\n  "
            "part: [x0, x1]\n"
            f"  tool: [t0..{tools - 1}]\n  state: [s0..{states - 1}]\nstatics:\n"
            + "".join(f"  - {each}\n" for each in facts)
            + "initial:\n"
            + "".join(f"  - {each}\n" for each in start)
            + "goals:\n"
            + "".join(f"  - {each}\n" for each in goals),
        )


KINDS: dict[str, tuple[Callable[[random.Random, int, int, int], Iterator[Query]], int]] = {
    "roads": (roads, 60),
    "carts": (carts, 30),
    "workshop": (workshop, 25),
}


def written(
    kind: str, number: int, seed: int, size: int, folder: Path, every: int = 10
) -> list[Path]:
    """The files of the queries of a kind."""
    queries, usual = KINDS[kind]
    files = []
    for place, (domain, problem) in enumerate(
        queries(random.Random(seed), number, size or usual, every)
    ):
        (folder / "domain.yaml").write_text(domain, encoding="utf-8")
        file = folder / "problems" / f"q{place}.yaml"
        file.parent.mkdir(exist_ok=True)
        file.write_text(problem, encoding="utf-8")
        files.append(file)
    return files


def _ask(file: Path, store: str) -> tuple[float, Outcome, dict[str, Any]]:
    """The seconds of a query in this process, what it answered, and where that comes from."""
    problem = load(file).problem
    assert problem is not None
    gc.collect()
    started = time.process_time()
    run, origin = plan_with_library(
        problem, SearchLimits(), None, SequenceChoice.SEQUENCE, store, folded=False, stays=True
    )
    seconds = time.process_time() - started
    if isinstance(run.outcome, Found):
        assert validate_plan(problem, run.outcome.plan) == []
    return seconds, run.outcome, origin


def compared(files: list[Path], store: str) -> Iterator[Row]:
    """Each query without a library and with it."""
    for file in files:
        plain_s, plain, _ = _ask(file, "")
        with_s, found, origin = _ask(file, store)
        row: Row = {
            "query": file.stem,
            "origin": origin["source"]["origin"],
            "with_s": with_s,
            "plain_s": plain_s,
        }
        yield row | {"cost": _cost(found), "plain_cost": _cost(plain)}


def _cost(outcome: Outcome) -> int | None:
    return outcome.plan.cost if isinstance(outcome, Found) else None


def by_commands(files: list[Path], store: str) -> Iterator[Row]:
    """Each query by two commands, without a library and with it."""
    for file in files:
        plain_s, plain = _command(file)
        with_s, found = _command(file, "--store", store)
        yield {
            "query": file.stem,
            "origin": found["source"]["origin"],
            "with_s": with_s,
            "plain_s": plain_s,
        } | {
            "cost": found["plan"]["cost"],
            "plain_cost": plain["plan"]["cost"],
        }


def _command(file: Path, *options: str) -> tuple[float, dict[str, Any]]:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = ["cellwright", "plan", str(file), "--format", "json", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, json.loads(done.stdout)["data"]


def judged(title: str, rows: list[Row]) -> Iterator[tuple[str, bool]]:
    """Costs and times against the bars."""
    both = [row for row in rows if row["cost"] is not None and row["plain_cost"]]
    lost = [row["query"] for row in rows if row["cost"] is None and row["plain_cost"] is not None]
    ratios = [max(row["cost"], 1) / max(row["plain_cost"], 1) for row in both]
    mean, worst = statistics.geometric_mean(ratios), max(ratios)
    spent = sum(row["with_s"] for row in rows) / sum(row["plain_s"] for row in rows)
    origins = dict(Counter(row["origin"] for row in rows))
    plain = 1000 * sum(row["plain_s"] for row in rows) / len(rows)
    yield f"{title}: cost {mean:.3f} of fresh plans in the mean, <= {MEAN}", mean <= MEAN
    yield f"{title}: cost {worst:.3f} at worst, <= {WORST}", worst <= WORST
    yield f"{title}: time {spent:.2f} of {plain:.1f} ms each, <= {TIME}; {origins}", spent <= TIME
    yield f"{title}: lost {lost}", not lost


def show(title: str, rows: list[Row]) -> None:
    """Print every query."""
    table = Table(title=title)
    for name in rows[0]:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(
            *(f"{each:.4f}" if isinstance(each, float) else str(each) for each in row.values())
        )
    console.print(table)


def main() -> None:
    """Run the kinds asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kind", action="append", choices=list(KINDS))
    parser.add_argument("--queries", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--size", type=int, default=0, help="places of a map, states of a part")
    parser.add_argument(
        "--every", type=int, default=10, help="queries between two changes of a cell"
    )
    parser.add_argument(
        "--commands", type=int, default=0, help="queries that are planned by commands, too"
    )
    parser.add_argument("--each", action="store_true", help="print every query")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    gc.set_threshold(100_000)  # as the command line does
    found: dict[str, list[Row]] = {}
    verdicts: list[tuple[str, bool]] = []
    for kind in options.kind or KINDS:
        with tempfile.TemporaryDirectory() as folder:
            files = written(
                kind, options.queries, options.seed, options.size, Path(folder), options.every
            )
            found[kind] = list(compared(files, f"{folder}/library.db"))
            if options.commands:
                some = files[: options.commands]
                found[f"{kind}, commands"] = list(by_commands(some, f"{folder}/commands.db"))
    for title, rows in found.items():
        if options.each:
            show(title, rows)
        verdicts += judged(title, rows)
    for said, met in verdicts:
        console.print(
            f"{'met   ' if met else 'MISSED'} {said}", style="green" if met else "bold red"
        )
    if options.json:
        options.json.write_text(json.dumps(found, indent=1), encoding="utf-8")
    sys.exit(0 if all(met for _, met in verdicts) else 1)


if __name__ == "__main__":
    main()

"""Long work for every verb, for the table of limits: what would run for longer than its limit,
if it were let.
"""

import json
import random
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

ENDLESS = {
    "constant": ["#const k=1000000000.", "n(1..k)."],
    "range": ["n(1..30000*30000)."],
    "terms": ["n(1).", "q(f(bolt)).", "q(f(X)) :- q(X)."],
    "product": ["m(1..1000).", "n(X*Y*Z) :- m(X), m(Y), m(Z)."],
}
DOMAIN = """domain: endless
include: [rules.lp]
types: {item: object}
objects: {item: [bolt]}
statics:
  n(int): {}
fluents:
  done(item): {}
operators:
  act(Item):
    adds: done(Item)
"""
PROBLEM = "problem: p\ndomain: domain.yaml\ngoals: [done(bolt)]\n"
COUNTERS = """(define (domain counters) (:requirements :typing :numeric-fluents) (:types counter)
  (:functions (value ?c - counter) (most))
  (:action up :parameters (?c - counter) :precondition (<= (+ (value ?c) 1) (most)) :effect (increase (value ?c) 1))
  (:action down :parameters (?c - counter) :precondition (>= (value ?c) 1) :effect (decrease (value ?c) 1)))
"""
COMMAND = [sys.executable, "-m", "cellwright.engine.faces.cli"]
RECORDS = 12  # behind which a run is killed


@dataclass(frozen=True)
class Work:
    """A command line with much to do; how many processes it works with, and megabytes that it may
    be limited to.

    `presses` is how often one presses Ctrl-C to end it at once.
    """

    name: str
    arguments: tuple[str, ...]
    processes: int = 1
    megabytes: int = 200
    presses: int = 1


def works(folder: Path) -> Iterator[Work]:
    """All of them. The files that they need are written into a folder."""
    store = str(folder / "library.db")
    yield from _endless(folder)
    yield from _orders(folder)
    yield from _knowledge(folder, store)
    yield from _motions(folder)
    yield from _runs(folder, store)
    yield from _files(folder)


def _endless(folder: Path) -> Iterator[Work]:
    """Rules whose facts have no end."""
    yield from (_grounding(folder, name, rules) for name, rules in ENDLESS.items())
    yield Work("check endless", ("check", str(folder / "range" / "problem.yaml")))
    yield Work("schedule endless", ("schedule", str(folder / "terms" / "problem.yaml")))
    yield Work("explain endless", ("explain", str(folder / "product" / "problem.yaml")))


def _orders(folder: Path) -> Iterator[Work]:
    """Plans, schedules and tours."""
    tour, cities, numbers = _tour(folder, 1500), _tour(folder, 20000), _counters(folder, 40)
    yield Work("plan 1,000 points", ("plan", _large()))
    yield Work("plan anytime", ("plan", "themse/four", "--anytime"))
    yield Work("plan shortest", ("plan", "themse/four", "--strategy", "shortest"))
    yield Work("plan asp", ("plan", "themse/four", "--strategy", "asp"))
    yield Work("plan race", ("plan", "themse/four", "--race", "--anytime"), 2)
    yield Work("plan numeric", ("plan", "--pddl", *numbers))
    yield Work("plan least", ("plan", "themse/four", "--objective", "makespan"))
    yield Work("schedule", ("schedule", _shop(folder, 30, 20)))
    yield Work("schedule 1,000 points", ("schedule", _large()))
    yield Work("sequence 1,500 cities", ("sequence", tour, "--closed"))
    yield Work("sequence 20,000 cities", ("sequence", cities, "--closed"))
    yield Work("sequence 1,000 points", ("sequence", _large()))


def _knowledge(folder: Path, store: str) -> Iterator[Work]:
    """What is known, learned and found out."""
    yield Work("explain", ("explain", "themse/unsolvable"))
    yield Work("diagnose tree", ("diagnose", "themse", "--exception", _exception(), "--tree"))
    yield Work("prepare", ("prepare", "themse", "--jobs", "1", "--store", store))
    yield Work("prepare in two", ("prepare", "themse", "--jobs", "2", "--store", store), 3)
    yield Work("states", ("states", "themse"))
    yield Work("revise", ("revise", _plan(folder), "--done", "1..4", "--both"))
    yield Work("macros learn", ("macros", "learn", _plan(folder), "--store", store))


def _motions(folder: Path) -> Iterator[Work]:
    """Motions, and parts that are placed."""
    yield Work("plan motion", ("plan", "themse/four", "--motion"))
    yield Work("sequence motion", ("sequence", "bulkhead/three_stations", "--cost", "motion"))
    yield Work(
        "motion plan", ("motion", "plan", "themse", "--from", "home", "--to", "0, -90, 90, 0, 0, 0")
    )
    yield Work("motion problems", ("motion", "problems", "bulkhead", "--count", "200"))
    yield Work("motion travel", ("motion", "travel", _large()))
    yield Work(
        "motion play", ("motion", "play", "themse/four", "--output", str(folder / "film.gltf"))
    )
    yield Work("place", ("place", "angle", "on", "base", "--scene", "handey"))
    yield Work("handey assemble", ("handey", "assemble", "base", "--scene", "handey/five"))
    yield Work(
        "handey align",
        ("handey", "align", "angle.heel", "parallel", "base.front", "--scene", "handey"),
    )


def _runs(folder: Path, store: str) -> Iterator[Work]:
    """Runs, and what is left of them."""
    yield Work("run", _run("themse/one", store, "--factor", "0.05"), presses=2)
    yield Work(
        "run with faults", _run("themse/four", store, "--fault", "pick=not_gripped"), presses=2
    )
    yield Work("run motion", _run("themse/one", store, "--motion"), presses=2)
    yield Work(
        "resume", ("resume", _stopped(folder), "--store", str(folder / "stopped.db")), presses=2
    )
    yield Work("results", ("results", "stopped", "--store", str(folder / "stopped.db")))
    yield Work("store check", ("store", "check", "--store", str(folder / "stopped.db")))


def _files(folder: Path) -> Iterator[Work]:
    """Files that are read, checked and written."""
    yield Work("validate", ("validate", _plan(folder)))
    yield Work(
        "import csv",
        ("import", "csv", _table(folder, 20000), "--output", str(folder / "points.yaml")),
    )
    yield Work("export pddl", ("export", "pddl", _large(), "--ground", "--output", str(folder)))
    yield Work(
        "cell show",
        ("cell", "show", "bulkhead/three_stations", "--output", str(folder / "cell.svg")),
    )
    yield Work("check", ("check", "themse"))
    yield Work("measurement list", ("measurement", "list", _large()))
    yield Work("test", ("test", "themse"))


def _grounding(folder: Path, name: str, rules: Sequence[str]) -> Work:
    place = folder / name
    place.mkdir(exist_ok=True)
    (place / "domain.yaml").write_text(DOMAIN)
    (place / "problem.yaml").write_text(PROBLEM)
    (place / "rules.lp").write_text("\n".join(rules) + "\n")
    return Work(f"plan endless {name}", ("plan", str(place / "problem.yaml")))


def _large() -> str:
    return str(Path(__file__).parents[1] / "domains" / "bulkhead" / "large" / "thousand.yaml")


def _exception() -> str:
    from cellwright.kb.loader.fault_base import load_faults

    model = load_faults(Path(__file__).parents[1] / "domains" / "themse" / "domain.yaml")[0]
    assert model is not None
    return max(model.exceptions, key=lambda each: len(model.exceptions[each].counts))


def _run(target: str, store: str, *more: str) -> tuple[str, ...]:
    return "run", target, "--store", store, *more


def _tour(folder: Path, count: int) -> str:
    chance, path = random.Random(count), folder / f"cities_{count}.tsp"
    cities = [
        f"{each} {chance.randrange(10**6)} {chance.randrange(10**6)}"
        for each in range(1, count + 1)
    ]
    head = (
        f"NAME : cities\nTYPE : TSP\nDIMENSION : {count}\nEDGE_WEIGHT_TYPE : "
        "EUC_2D\nNODE_COORD_SECTION\n"
    )
    path.write_text(head + "\n".join(cities) + "\nEOF\n")
    return str(path)


def _shop(folder: Path, jobs: int, machines: int) -> str:
    chance, path = random.Random(jobs), folder / "shop.txt"
    lines = [f"{jobs} {machines}"]
    for _ in range(jobs):
        order = chance.sample(range(machines), machines)
        lines.append(" ".join(f"{machine} {chance.randrange(1, 100)}" for machine in order))
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def _counters(folder: Path, count: int) -> tuple[str, str]:
    """Counters that have to stand in descending order: many steps, and more ways to reorder
    them than there is time for.
    """
    names = [f"c{each}" for each in range(count)]
    domain, problem = folder / "counters.pddl", folder / "descending.pddl"
    values = " ".join(f"(= (value {name}) 0)" for name in names)
    goals = " ".join(f"(<= (+ (value {two}) 1) (value {one}))" for one, two in pairwise(names))
    domain.write_text(COUNTERS)
    problem.write_text(
        f"(define (problem d) (:domain counters) (:objects {' '.join(names)} - counter)\n"
        f"(:init (= (most) {3 * count}) {values}) (:goal (and {goals})))\n"
    )
    return str(domain), str(problem)


def _table(folder: Path, count: int) -> str:
    chance, path = random.Random(count), folder / "points.csv"
    lines = ["name,x,y,z,nx,ny,nz,kind,tolerance"]
    for each in range(count):
        place = f"{chance.uniform(-450, 450):.3f},{chance.uniform(-950, 950):.3f}"
        lines.append(f"m{each},{place},0,0,0,-1,thickness,0.2")
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def _plan(folder: Path) -> str:
    """A file with the plan for all points, made once."""
    path = folder / "plan.json"
    if not path.exists():
        path.write_text(_told("plan", "bulkhead/twelve_points", "--format", "json"))
    return str(path)


def _stopped(folder: Path) -> str:
    """The name of a run that was killed in the middle, and can be resumed; made once."""
    store, events = folder / "stopped.db", folder / "events"
    if not events.exists():
        events.touch()
        words = ["run", "themse/one", "--name", "stopped", "--store", str(store), "--factor", "0.2"]
        line = [*COMMAND, *words, "--events", str(events)]
        with subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
            while run.poll() is None and events.read_text("utf-8").count("\n") < RECORDS:
                time.sleep(0.1)
            run.kill()
    return "stopped"


def _told(*arguments: str) -> str:
    """What a command prints."""
    return subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, check=False
    ).stdout


if __name__ == "__main__":
    print(json.dumps([each.arguments for each in works(Path(sys.argv[1]))], indent=1))

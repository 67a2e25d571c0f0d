"""Bulkheads with any number of points, and days of measuring on them: problems and valid plans
without a planner.

A day is written by a fixed rule (retract, change the tool if need be, go there, measure), so that
thousands of different plans are there in seconds; generalising and checking judge them as they
judge any other.
"""

import random
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from cellwright.kb.loader import load
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term

ARM = Function("t3_746")
PROBE, LASER = Function("us_probe"), Function("slra")
TOOLS = {"thickness": PROBE, "profile": LASER}
STARTS = ("contact", "approach", "rack")
FINALS = ("", "holding", "location", "at")


def kind_of(point: int) -> str:
    """Two points in three are for the ultrasonic probe."""
    return "profile" if point % 3 == 0 else "thickness"


def cell(points: int) -> Problem:
    """A bulkhead with points m1 to mN: at m1 in contact, with the ultrasonic probe in the hand."""
    needs = "\n".join(
        f"  - needs(m{n}, {kind_of(n)})\n  - position({_place(n)})" for n in range(1, points + 1)
    )
    text = (
        f"problem: points_{points}\ndomain: bulkhead\nobjects:\n  measurement: "
        f"[m1..{points}]\nstatics:\n{needs}\n"
        "initial:\n  - at(t3_746, in_contact_point(meas(m1))), holding(t3_746, us_probe)\n"
        "goals:\n  - measured(us_probe, t3_746, meas(m2))\n"
    )
    with TemporaryDirectory() as folder:
        file = Path(folder) / "points.yaml"
        file.write_text(text, encoding="utf-8")
        problem = load(file).problem
    assert problem is not None
    return problem


def _place(point: int) -> str:
    """A point and where it is: rows of a hundred, 40 mm apart, in micrometres."""
    row, column = divmod(point - 1, 100)
    return f"m{point}, {40_000 * column}, {40_000 * row}, 0"


def atom(name: str, *arguments: Term) -> Atom:
    """An atom or compound term."""
    return Function(name, arguments)


def meas(point: int) -> Term:
    """The place of a point."""
    return atom("meas", Function(f"m{point}"))


def measured(point: int) -> Atom:
    """The goal of measuring a point with the tool for its kind."""
    return atom("measured", TOOLS[kind_of(point)], ARM, meas(point))


@dataclass(frozen=True)
class Day:
    """What is measured in which order, from which start, and what is wanted at the end beside
    the values.
    """

    start: str
    start_point: int
    tool: Function | None
    points: tuple[int, ...]
    final: str = ""
    coated: frozenset[int] = frozenset()  # points that have couplant on them already

    def initial(self) -> tuple[Atom, ...]:
        """The whole initial state."""
        place = atom("rack", PROBE) if self.start == "rack" else meas(self.start_point)
        touching = self.start == "contact"
        state = [atom("at", ARM, atom("in_contact_point" if touching else "approach_point", place))]
        state += [
            atom("location", t, ARM, Function("in_rack")) for t in (PROBE, LASER) if t != self.tool
        ]
        state.append(atom("holding", ARM, self.tool) if self.tool else atom("hand_empty", ARM))
        state.append(atom("stands", ARM, Function("middle")))
        state += [
            atom("couplant_applied", atom("goal_point", meas(n))) for n in sorted(self.coated)
        ]
        return tuple(state)

    def goals(self) -> And:
        """One goal per point, and the final one."""
        last = TOOLS[kind_of(self.points[-1])]
        extra = {
            "": [],
            "holding": [atom("holding", ARM, _other(last))],
            "location": [atom("location", last, ARM, Function("in_rack"))],
            "at": [atom("at", ARM, atom("approach_point", meas(self.start_point)))],
        }[self.final]
        return And(tuple(Literal(each) for each in [*map(measured, self.points), *extra]))

    def plan(self) -> Plan:
        """The day by the fixed rule."""
        return _Script(self).plan()


def _other(tool: Function) -> Function:
    return LASER if tool == PROBE else PROBE


@dataclass
class _Script:
    day: Day
    steps: list[Step] = field(default_factory=list)

    def plan(self) -> Plan:
        day = self.day
        self.tool = day.tool
        self.place = atom("rack", PROBE) if day.start == "rack" else meas(day.start_point)
        self.contact = day.start_point if day.start == "contact" else 0
        for point in day.points:
            self._measure(point)
        last = TOOLS[kind_of(day.points[-1])]
        if day.final == "holding":
            self._take(_other(last))
        elif day.final == "location":
            self._put_down()
        elif day.final == "at":
            self._go(meas(day.start_point))
        return Plan(tuple(self.steps))

    def _measure(self, point: int) -> None:
        self._take(TOOLS[kind_of(point)])
        self._go(meas(point))
        name = Function(f"m{point}")
        if kind_of(point) == "profile":
            self._step("laser_measure", LASER, ARM, name)
            return
        if point not in self.day.coated:
            self._step("apply_couplant", ARM, name)
        self._step("move_contact", ARM, name)
        self.contact = point
        self._step("us_measure", PROBE, ARM, name)

    def _take(self, tool: Function) -> None:
        if self.tool == tool:
            return
        if self.tool is not None:
            self._put_down()
        self._go(atom("rack", tool))
        self._step("pick_up", ARM, tool)
        self.tool = tool

    def _put_down(self) -> None:
        assert self.tool is not None
        self._go(atom("rack", self.tool))
        self._step("put_down", ARM, self.tool)
        self.tool = None

    def _go(self, place: Term) -> None:
        if self.contact:
            self._step("move_retract", ARM, Function(f"m{self.contact}"))
            self.contact = 0
        if self.place != place:
            self._step("move", ARM, self.place, place)
            self.place = place

    def _step(self, name: str, *arguments: Term) -> None:
        number = len(self.steps) + 1
        after = (StepId(number - 1),) if number > 1 else ()
        held = tuple(each for each in arguments if each in (ARM, PROBE, LASER))
        self.steps.append(Step(StepId(number), Function(name, arguments), after, held))


def some_day(draw: random.Random, points: int, most: int = 6) -> Day:
    """A random day on a bulkhead, with up to `most` points."""
    visits = tuple(draw.sample(range(1, points + 1), draw.randint(1, most)))
    near = draw.random() < 0.3
    start_point = draw.choice(visits) if near else draw.randint(1, points)
    start = draw.choice(STARTS)
    tool = PROBE if start == "contact" else draw.choice([PROBE, LASER, None])
    coated = frozenset(n for n in visits if kind_of(n) == "thickness" and draw.random() < 0.3)
    return Day(start, start_point, tool, visits, draw.choice(FINALS), coated)


def again(day: Day, draw: random.Random, points: int) -> Day:
    """The same day for other points of the same kinds."""
    names: dict[int, int] = {}
    for old in (*day.points, day.start_point):
        if old not in names:
            free = [
                n
                for n in range(1, points + 1)
                if kind_of(n) == kind_of(old) and n not in names.values()
            ]
            names[old] = draw.choice(free)
    visits = tuple(names[point] for point in day.points)
    coated = frozenset(names[point] for point in day.coated)
    return Day(day.start, names[day.start_point], day.tool, visits, day.final, coated)


def pattern(day: Day) -> tuple[object, ...]:
    """What days have in common whose plans differ in the names of points alone."""
    kinds = tuple((kind_of(point), point in day.coated) for point in day.points)
    own = day.points.index(day.start_point) if day.start_point in day.points else -1
    where = own if day.start != "rack" or day.final == "at" else -1
    return day.start, where, day.tool, kinds, day.final


def different_days(number: int, points: int, seed: int) -> list[Day]:
    """Days of which no two have the same pattern."""
    draw = random.Random(seed)
    found: dict[tuple[object, ...], Day] = {}
    while len(found) < number:
        day = some_day(draw, points)
        found.setdefault(pattern(day), day)
    return list(found.values())

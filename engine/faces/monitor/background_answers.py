"""Slow answers for a page, computed in another process: motions, why a step is there, measurement
order.
"""

import asyncio
import multiprocessing
import re
import time
from collections.abc import Collection, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from functools import lru_cache
from typing import Any
from xml.sax.saxutils import quoteattr, unescape

import numpy as np

from cellwright.engine.faces.monitor.chosen_item import names_any
from cellwright.engine.faces.monitor.run_follower import RunFollower
from cellwright.engine.formats import report
from cellwright.engine.formats.report.drawing.tour_svg import draw_tour
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.part_measurements import measurements_of
from cellwright.engine.model.tour_problem import Tour, TourProblem, Visit
from cellwright.engine.model.troubleshooting import expected_cost
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.execution.journal_motions import Retracing, TakenStep
from cellwright.engine.pipelines.execution.plan_records import read_ground_atom
from cellwright.engine.pipelines.explanation.step_purposes import later_uses
from cellwright.engine.pipelines.jobs.parent_exit import end_with_parent
from cellwright.engine.pipelines.recovery.diagnosis_case import open_diagnosis_case
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.grounding import ground
from cellwright.kb import loader
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.name_conventions import Conventions
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Number

BATCH_S = 1.0  # how long is searched before the page gets what was found
MAX_RETRACED_RUNS = 4  # runs whose motions a process goes on with
Target = tuple[str, str, str]  # target, goals, command, as a run was begun with


class RunMotions:
    """The motions of the steps that one run has begun, in their order; `why_none` tells why
    there are none.
    """

    def __init__(self, store: str, run: str, target: Target) -> None:
        self.taken: list[TakenStep] = []
        self.why_none = ""
        self._asked = (store, run, target)
        self._looked = 0
        self._busy = False

    @property
    def looked(self) -> int:
        """The number of the last record whose motion was looked for."""
        return self._looked

    async def refresh(self, number: int, workers: ProcessPoolExecutor) -> None:
        """Look for the motions up to a record, unless that goes on already."""
        if self._busy or self.why_none:
            return
        self._busy = True
        try:
            while self._looked < number and not self.why_none:
                asked = (*self._asked, self._looked, number)
                answer = await asyncio.wrap_future(workers.submit(further_motions, *asked))
                self._looked, motions, self.why_none = answer
                self.taken += motions
        except BrokenExecutor as gone:
            self.why_none = f"the process that looks for motions has ended: {gone}"
        finally:
            self._busy = False

    def at(self, number: int) -> Sequence[TakenStep]:
        """The motions that had begun up to a record."""
        count = len(self.taken)
        while count and self.taken[count - 1].number > number:
            count -= 1
        return self.taken[:count]


def worker_pool() -> ProcessPoolExecutor:
    """One process that looks for motions. It ends with the monitor, however that ends."""
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), end_with_parent)


def further_motions(
    store: str, run: str, target: Target, since: int, until: int
) -> tuple[int, list[TakenStep], str]:
    """The number of the record that was looked at last, the motions of steps behind record
    `since`, and why there can be none.
    """
    try:
        follower, retracing, seen = _retracing_of(store, run, target)
    except InvalidInput as refused:
        return until, [], refused.diagnostics[0].message
    follower.refresh()
    start, ready = (
        time.monotonic(),
        [seen_motion for seen_motion in seen if since < seen_motion.number <= until],
    )
    last = max(since, retracing.number)
    for record in follower.records[last:until]:
        if (motion := retracing.take(record)) is not None:
            seen.append(motion)
            ready.append(motion)
        last = record.number
        if time.monotonic() - start > BATCH_S:
            break
    return max(last, min(until, retracing.number)), ready, ""


@lru_cache(MAX_RETRACED_RUNS)
def _retracing_of(
    store: str, run: str, target: Target
) -> tuple[RunFollower, Retracing, list[TakenStep]]:
    problem = planning.problem_of(*target)
    cell = loader.cell_of_problem(problem)
    return RunFollower(store, run), Retracing.of(problem, cell, geometry_backend()), []


MAX_TASKS = 4  # that are kept


@lru_cache(MAX_TASKS)
def _ground_task(target: Target) -> GroundTask:
    return ground(planning.problem_of(*target))


def step_reasons(target: Target, steps: Sequence[dict[str, Any]], number: int) -> list[str]:
    """What a step (by its id) of a plan is good for; `steps` are those of the plan in its
    order, as a record has them.
    """
    place = [step["id"] for step in steps].index(number)
    try:
        task = _ground_task(target)
    except InvalidInput as refused:
        return [refused.diagnostics[0].message]
    sequence = [read_ground_atom(step["step"]) for step in steps]
    adds = [list(map(read_ground_atom, step.get("adds", ()))) for step in steps]
    events = [*adds[place], *map(read_ground_atom, steps[place].get("events", ()))]
    adds[place] = events
    return [
        f"brings {fact}" + (f", which {consumer} needs" if consumer is not None else "")
        for fact, consumer in later_uses(task, sequence, adds, place)
    ]


def exception_tree_svg(target: str, exception: str, step: str) -> str:
    """The decision tree of an exception at a step as SVG; a sentence if there is none."""
    try:
        case_desk = open_diagnosis_case(target, exception, step)
    except InvalidInput as refused:
        return refused.diagnostics[0].message
    tree = case_desk.session.selector.tree(case_desk.session.standing)
    return report.decision_tree_svg(case_desk.session.case.problem, tree, expected_cost(tree))


def contact_states(target: str, facts: Collection[str]) -> tuple[str, list[tuple[str, ...]]]:
    """The net of the cell's contact states as SVG, marked as facts tell, and for each object: its
    place, and who else is there.

    A sentence and nothing if the cell has no contact model.
    """
    from cellwright.engine.pipelines.contact_states.net_marking import marking_of_facts, player_of

    try:
        player = player_of(target)
    except InvalidInput as refused:
        return refused.diagnostics[0].message, []
    marked = marking_of_facts(player, facts)
    rows = [
        (name, place, ", ".join(other_object for other_object in inside if other_object != name))
        for place, clusters in marked.items()
        for inside in clusters
        for name in inside
    ]  # fmt: skip
    return report.draw_net(player.net, marked), sorted(rows)


MICROMETRE_M = 1e-6
VISIT_CIRCLE = re.compile(r'<circle class="visit"([^>]*)><title>(.*?)</title>')
LIT_VISIT = 'style="filter: drop-shadow(0 0 4px #d02090); stroke: #d02090; stroke-width: 4"'
Spot = tuple[float, float, float]


def sequence_picture(target: Target, plan: dict[str, Any]) -> str | None:
    """The SVG; None if the plan measures nothing whose place is known."""
    words, spots = _measured_places(target)
    visits = []
    steps = {plan_step["id"]: plan_step for plan_step in plan.get("steps", ())}
    for number in plan.get("order", ()):
        step = steps[number]
        for fact in map(read_ground_atom, step.get("adds", ())):
            if fact.name == words.measured and (place := str(fact.arguments[-1])) in spots:
                name, at = spots[place]
                visits.append(Visit(name, at, str(fact.arguments[0])))
    if len(visits) < 2:
        return None
    order, ways = tuple(range(len(visits))), np.zeros((len(visits), len(visits)), dtype=np.int64)
    return draw_tour(Tour(order, 0, 0), TourProblem("sequence", tuple(visits), ways, closed=False))


def pickable_picture(drawn: str, chosen: str) -> str:
    """The picture with dots that a click chooses; those that belong to what is chosen have a
    rim.
    """

    def step(found: re.Match[str]) -> str:
        name = unescape(found[2].partition(": ")[2])
        rim = f' {LIT_VISIT} data-chosen="yes"' if chosen and names_any([name], [chosen]) else ""
        told = f'class="visit step" tabindex="0" role="button" data-step={quoteattr(name)}{rim}'
        return f"<circle {told}{found[1]}><title>{found[2]}</title>"

    return VISIT_CIRCLE.sub(step, drawn)


@lru_cache(16)
def _measured_places(target: Target) -> tuple[Conventions, dict[str, tuple[str, Spot]]]:
    """The domain's words; and for each place the measurement that is made there, with its point
    in metres.
    """
    try:
        problem = planning.problem_of(*target)
    except InvalidInput:
        return Conventions(), {}
    words, spots = (
        problem.domain.conventions,
        {**_of_cell(problem, target[0]), **_of_problem(problem)},
    )
    return words, {words.place(name): (name, at) for name, at in spots.items()}


def _of_problem(problem: Problem) -> dict[str, Spot]:
    spots = {}
    for fact in problem.statics:
        numbers = [
            argument.value * MICROMETRE_M
            for argument in fact.arguments[1:]
            if isinstance(argument, Number)
        ]
        if fact.name == problem.domain.conventions.position and len(numbers) == 3:
            spots[str(fact.arguments[0])] = (numbers[0], numbers[1], numbers[2])
    return spots


def _of_cell(problem: Problem, target: str) -> dict[str, Spot]:
    try:
        places = cell_of(target).places
    except InvalidInput:
        return {}
    words = problem.domain.conventions
    named = {name: places.get(words.place(name)) for name in measurements_of(problem)}
    return {
        name: place.placement.pose.position_m for name, place in named.items() if place is not None
    }

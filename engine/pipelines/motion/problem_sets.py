"""Sets of motion problems: drawn, saved, replayed and compared, also on many processes."""

import contextlib
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from cellwright.engine.kernels.arrays import Longs
from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.motion_values import Blocked, Moved
from cellwright.engine.pipelines.jobs import (
    ResultLedger,
    WorkCrew,
    WorkKind,
    WorkUnit,
    carried_out,
    show_nothing,
)
from cellwright.engine.pipelines.jobs.input_digests import (
    content_digest,
    require_same,
    shared_store,
)
from cellwright.engine.pipelines.motion.arm_motion import (
    ArmMotion,
    MotionSite,
    MotionWish,
    plan_named_motion,
)
from cellwright.engine.pipelines.motion.motion_legs import arm_named, tool_of
from cellwright.engine.pipelines.motion.travel_times import (
    TravelStations,
    TravelTable,
    make_travel_table,
    table_stations,
)
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.motion.roadmap import Roadmap, map_nodes
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.cell_model import Place, Placement
from cellwright.kb.stopping import StoppedByCaller
from cellwright.kb.targets import find_target

DRAWN_ROOM_M = 0.005  # that drawn configurations have around them
MAX_DRAWS = 400  # for each configuration that is wanted
ANSWER_DIGITS = 10


@dataclass(frozen=True, slots=True)
class MotionProblem:
    """A start and a goal, as people name them; `answer` is what a replay said, if one was saved."""

    start: str
    goal: str
    answer: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class ReplayedAnswer:
    """What the planner made of a problem: a status, the time of the motion (s), and a digest of
    its path.
    """

    problem: MotionProblem
    status: str
    duration_s: float
    proved: bool
    looked: int
    digest: str

    @property
    def content(self) -> dict[str, Any]:
        """What is saved of the answer."""
        return {"status": self.status, "path": self.digest}

    @property
    def same(self) -> bool | None:
        """Whether the saved answer is the same; None if none was saved."""
        return None if self.problem.answer is None else dict(self.problem.answer) == self.content


def draw_motion_problems(
    site: MotionSite, count: int, seed: int, tool: str = ""
) -> list[MotionProblem]:
    """Problems between free configurations of the first arm, every second one to a place of the
    cell that takes the same tool.
    """
    cell, rng = site.world.cell, np.random.default_rng(seed)
    arm, tool = arm_named("", cell, "TARGET"), tool_of(tool, cell)
    ground = PlanningScene(site.reach.checker(Place("", Placement(), arm, tool)))
    own = slice(
        site.world.first_carriers[arm],
        site.world.first_carriers[arm] + site.world.models[arm].joints.count,
    )
    joints = ground.scene.joints
    low, high = np.maximum(joints.lower, -np.pi), np.minimum(joints.upper, np.pi)
    where = np.repeat(site.world.configuration[None], count * MAX_DRAWS, axis=0)
    where[:, own] = rng.uniform(low, high, (len(where), joints.count))[:, own]
    free = where[ground.clearance(where, 2 * DRAWN_ROOM_M) > DRAWN_ROOM_M][: 2 * count, own]
    if len(free) < 2 * count:
        message = f"only {len(free)} of {len(where)} drawn configurations are free"
        raise InvalidInput(
            [Diagnostic(Source("--count"), "K705", message, "ask for fewer problems")]
        )
    places = [
        name for name, place in cell.places.items() if place.arm == arm and place.tool == tool
    ]
    slides = site.world.models[arm].joints.prismatic
    named = [_joint_text(arm, q, slides) for q in free]
    goals = [
        str(rng.choice(places)) if n % 2 and places else name for n, name in enumerate(named[1::2])
    ]
    return [MotionProblem(start, goal) for start, goal in zip(named[::2], goals, strict=True)]


def _joint_text(arm: str, q: Any, slides: Any) -> str:
    """Joint values as people write them, in degrees and metres, with all digits."""
    shown = [
        round(float(v if slid else np.degrees(v)), ANSWER_DIGITS)
        for v, slid in zip(q, slides, strict=True)
    ]
    return f"{arm}: {', '.join(map(str, shown))}"


def replay_problems(
    site: MotionSite, problems: Sequence[MotionProblem], wish: MotionWish
) -> Iterator[ReplayedAnswer]:
    """What the planner makes of each problem; a place out of reach is an answer, too."""
    for problem in problems:
        try:
            motion = plan_named_motion(site, problem.start, (problem.goal,), wish)
        except InvalidInput as error:
            if any(diagnostic.code != "K705" for diagnostic in error.diagnostics):
                raise
            yield ReplayedAnswer(problem, "out of reach", 0.0, False, 0, "")
        else:
            yield _summarise_motion(problem, motion)


def _summarise_motion(problem: MotionProblem, motion: ArmMotion) -> ReplayedAnswer:
    answer = motion.answer
    if not isinstance(answer, Moved):
        looked = answer.looked if isinstance(answer, Blocked) else 0
        open_ = isinstance(answer, Blocked) and answer.severed is None
        status = "gave up" if open_ else "infeasible"
        return ReplayedAnswer(problem, status, 0.0, False, looked, "")
    digest = hashlib.sha256(np.ascontiguousarray(motion.path()).tobytes()).hexdigest()[:16]
    return ReplayedAnswer(
        problem, "found", motion.times.duration_s, motion.proved, answer.looked, digest
    )


def problem_entries(problems: Sequence[MotionProblem]) -> list[dict[str, Any]]:
    """The problems for a file."""
    return [
        {"from": problem.start, "to": problem.goal}
        | ({"answer": dict(problem.answer)} if problem.answer else {})
        for problem in problems
    ]


def problems_in(content: Any, path: str) -> list[MotionProblem]:
    """The problems of a file that was read as JSON. Raises `InvalidInput` for another form."""
    listed = content.get("problems") if isinstance(content, dict) else None
    if not isinstance(listed, list) or not all(_is_problem(entry) for entry in listed):
        hint = 'write {"problems": [{"from": "home", "to": "0, 90, 0, 0, 0, 0"}, ...]}'
        raise InvalidInput(
            [Diagnostic(Source(path), "K413", "this is no set of problems for motions", hint)]
        )
    if not listed:
        hint = "draw some: cellwright motion problems CELL --count 20 -o SET"
        raise InvalidInput([Diagnostic(Source(path), "K413", "this set has no problems", hint)])
    return [MotionProblem(entry["from"], entry["to"], entry.get("answer")) for entry in listed]


def _is_problem(entry: Any) -> bool:
    ends = isinstance(entry, dict) and all(
        isinstance(entry.get(key), str) for key in ("from", "to")
    )
    return ends and isinstance(entry.get("answer", {}), dict)


LINES_PER_UNIT = 2_000  # lines of a table that are proved in one unit


@dataclass(frozen=True, slots=True)
class ReplayJob:
    """One problem of a set, in the cell of a target with this content."""

    target: str
    content: str
    problem: MotionProblem
    wish: MotionWish


@dataclass(frozen=True, slots=True)
class LineProofJob:
    """A stretch of the lines between the stations of a table."""

    target: str
    content: str
    tool: str
    wanted: tuple[str, ...]
    first: int


@dataclass(frozen=True, slots=True)
class ProvedLines:
    """Which lines of a stretch are proved to be free: a character 0 or 1 for each; none if it
    was not finished.
    """

    free: str = ""


def replayed_set(
    target: str,
    problems: Sequence[MotionProblem],
    wish: MotionWish,
    crew: WorkCrew,
    store: str,
    interrupted: Interrupted,
    progress: Callable[[int, int], None] = show_nothing,
) -> list[ReplayedAnswer]:
    """What the planner makes of each problem, in their order.

    Raises `InvalidInput`, and `StoppedByCaller` if it is interrupted.
    """
    where = str(find_target(target).absolute())
    own, key = content_digest(Path(where)), content_digest(Path(where), wish)
    jobs = [ReplayJob(where, own, problem, wish) for problem in problems]
    units = [
        WorkUnit(f"{where} {n}: {job.problem.start} to {job.problem.goal}", key, job)
        for n, job in enumerate(jobs)
    ]
    ledger = (
        ResultLedger(shared_store(store), _has_answer, _answer_entry, _answer_of_entry)
        if store
        else None
    )
    kind = WorkKind("motion set", _replay_job, _no_answer, ledger)
    replays: dict[str, ReplayedAnswer] = {}
    with contextlib.closing(carried_out(kind, units, crew, interrupted)) as answers:
        for unit, answer in answers:
            if not _has_answer(answer):
                raise StoppedByCaller
            replays[unit.name] = _with_problem(unit.job.problem, answer)
            progress(len(replays), len(units))
    return [replays[unit.name] for unit in units]


def table_by(
    target: str,
    tool: str,
    wanted_places: tuple[str, ...],
    crew: WorkCrew,
    store: str,
    interrupted: Interrupted,
) -> TravelTable:
    """The travel times between places; the lines between them are proved by a crew.

    Raises as `replayed_set` does.
    """
    where = str(find_target(target).absolute())
    own = content_digest(Path(where))

    def proved(stations: TravelStations, pairs: Longs) -> Roadmap:
        jobs = [
            LineProofJob(where, own, tool, wanted_places, first)
            for first in range(0, len(pairs), LINES_PER_UNIT)
        ]
        units = [
            WorkUnit(f"{where} {tool} {','.join(wanted_places)} {job.first}", own, job)
            for job in jobs
        ]
        ledger = (
            ResultLedger(shared_store(store), _is_proved, asdict, _proved_of) if store else None
        )
        kind = WorkKind("lines of a table", _prove_lines, _unproved_lines, ledger)
        proofs: dict[int, str] = {}
        with contextlib.closing(carried_out(kind, units, crew, interrupted)) as answers:
            for unit, answer in answers:
                if not answer.free:
                    raise StoppedByCaller
                proofs[unit.job.first] = answer.free
        free = np.array([mark == "1" for job in jobs for mark in proofs[job.first]], dtype=bool)
        return Roadmap(stations.nodes, pairs, free)

    return make_travel_table(MotionSite.of(target), tool, wanted_places, proved)


@lru_cache(maxsize=2)
def _site_of(target: str, own: str) -> MotionSite:
    """The cell of a target, once for many units, if it is the one that the command had.

    Raises `InvalidInput`.
    """
    require_same(Path(target), own)
    return MotionSite.of(target)


def _replay_job(job: ReplayJob, _interrupted: Interrupted) -> ReplayedAnswer:
    (replay,) = replay_problems(_site_of(job.target, job.content), [job.problem], job.wish)
    return replay


def _no_answer(job: ReplayJob, why: str) -> ReplayedAnswer:
    return ReplayedAnswer(job.problem, f"lost: {why}", 0.0, False, 0, "")


def _has_answer(replay: ReplayedAnswer) -> bool:
    return not replay.status.startswith("lost")


def _answer_entry(replay: ReplayedAnswer) -> dict[str, Any]:
    return {key: value for key, value in asdict(replay).items() if key != "problem"}


def _answer_of_entry(noted: Mapping[str, Any]) -> ReplayedAnswer:
    return ReplayedAnswer(MotionProblem("", ""), **noted)


def _with_problem(problem: MotionProblem, replay: ReplayedAnswer) -> ReplayedAnswer:
    """An answer with its problem, which a ledger does not hold."""
    return ReplayedAnswer(
        problem, replay.status, replay.duration_s, replay.proved, replay.looked, replay.digest
    )


@lru_cache(maxsize=2)
def _sought_stations(
    target: str, own: str, tool: str, wanted_places: tuple[str, ...]
) -> tuple[TravelStations, Longs]:
    """The stations of a table and the pairs of them, once for many units."""
    return table_stations(_site_of(target, own), tool, wanted_places)[:2]


def _prove_lines(job: LineProofJob, _interrupted: Interrupted) -> ProvedLines:
    ends_of_lines, pairs = _sought_stations(job.target, job.content, job.tool, job.wanted)
    free = map_nodes(
        ends_of_lines.ground, ends_of_lines.nodes, pairs[job.first : job.first + LINES_PER_UNIT]
    ).free
    return ProvedLines("".join("1" if is_free else "0" for is_free in free))


def _unproved_lines(_job: LineProofJob, _why: str) -> ProvedLines:
    return ProvedLines()


def _is_proved(proof: ProvedLines) -> bool:
    return bool(proof.free)


def _proved_of(noted: Mapping[str, Any]) -> ProvedLines:
    return ProvedLines(**noted)

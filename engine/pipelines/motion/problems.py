"""Problem sets for the planner: drawn in a cell, saved, and replayed; a replay says whether the answers are still the same."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cellwright.engine.model.motion import Blocked, Moved
from cellwright.engine.pipelines.motion.ends import arm_named, tool_of
from cellwright.engine.pipelines.motion.moving import Motion, Site, Wish, move
from cellwright.engine.stages.geometry.collision.ground import Ground
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.cell import Place, Placement

ROOM_M = 0.005  # that drawn configurations have around them
DRAWS = 400  # for each configuration that is wanted
DIGITS = 10


@dataclass(frozen=True, slots=True)
class Problem:
    """A start and a goal, as people name them; `answer` is what a replay said, if one was saved."""

    start: str
    goal: str
    answer: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class Replayed:
    """What the planner made of a problem: a status, the time of the motion (s), and a digest of its path."""

    problem: Problem
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


def drawn(site: Site, count: int, seed: int, tool: str = "") -> list[Problem]:
    """Problems between free configurations of the first arm, every second one to a place of the cell that takes the same tool."""
    cell, rng = site.world.cell, np.random.default_rng(seed)
    arm, tool = arm_named("", cell, "TARGET"), tool_of(tool, cell)
    ground = Ground(site.reach.checker(Place("", Placement(), arm, tool)))
    own = slice(
        site.world.first_carriers[arm], site.world.first_carriers[arm] + site.world.models[arm].joints.count
    )
    joints = ground.scene.joints
    low, high = np.maximum(joints.lower, -np.pi), np.minimum(joints.upper, np.pi)
    where = np.repeat(site.world.configuration[None], count * DRAWS, axis=0)
    where[:, own] = rng.uniform(low, high, (len(where), joints.count))[:, own]
    free = where[ground.clearance(where, 2 * ROOM_M) > ROOM_M][: 2 * count, own]
    if len(free) < 2 * count:
        message = f"only {len(free)} of {len(where)} drawn configurations are free"
        raise InvalidInput([Diagnostic(Source("--count"), "K705", message, "ask for fewer problems")])
    places = [name for name, place in cell.places.items() if place.arm == arm and place.tool == tool]
    slides = site.world.models[arm].joints.prismatic
    named = [_said(arm, q, slides) for q in free]
    goals = [str(rng.choice(places)) if n % 2 and places else name for n, name in enumerate(named[1::2])]
    return [Problem(start, goal) for start, goal in zip(named[::2], goals, strict=True)]


def _said(arm: str, q: Any, slides: Any) -> str:
    """Joint values as people write them, in degrees and metres, with all digits."""
    shown = [round(float(v if slid else np.degrees(v)), DIGITS) for v, slid in zip(q, slides, strict=True)]
    return f"{arm}: {', '.join(map(str, shown))}"


def replayed(site: Site, problems: Sequence[Problem], wish: Wish) -> Iterator[Replayed]:
    """What the planner makes of each problem; a place out of reach is an answer, too."""
    for problem in problems:
        try:
            found = move(site, problem.start, (problem.goal,), wish)
        except InvalidInput as error:
            if any(each.code != "K705" for each in error.diagnostics):
                raise
            yield Replayed(problem, "out of reach", 0.0, False, 0, "")
        else:
            yield _summed(problem, found)


def _summed(problem: Problem, found: Motion) -> Replayed:
    answer = found.answer
    if not isinstance(answer, Moved):
        looked = answer.looked if isinstance(answer, Blocked) else 0
        open_ = isinstance(answer, Blocked) and answer.severed is None
        status = "gave up" if open_ else "infeasible"
        return Replayed(problem, status, 0.0, False, looked, "")
    digest = hashlib.sha256(np.ascontiguousarray(found.path()).tobytes()).hexdigest()[:16]
    return Replayed(problem, "found", found.times.duration_s, found.proved, answer.looked, digest)


def entries(problems: Sequence[Problem]) -> list[dict[str, Any]]:
    """The problems for a file."""
    return [
        {"from": each.start, "to": each.goal} | ({"answer": dict(each.answer)} if each.answer else {})
        for each in problems
    ]


def problems_in(content: Any, path: str) -> list[Problem]:
    """The problems of a file that was read as JSON. Raises `InvalidInput` for another form."""
    listed = content.get("problems") if isinstance(content, dict) else None
    if not isinstance(listed, list) or not all(_is_problem(each) for each in listed):
        hint = 'write {"problems": [{"from": "home", "to": "0, 90, 0, 0, 0, 0"}, ...]}'
        raise InvalidInput([Diagnostic(Source(path), "K413", "this is no set of problems for motions", hint)])
    if not listed:
        hint = "draw some: cellwright motion problems CELL --count 20 -o SET"
        raise InvalidInput([Diagnostic(Source(path), "K413", "this set has no problems", hint)])
    return [Problem(each["from"], each["to"], each.get("answer")) for each in listed]


def _is_problem(entry: Any) -> bool:
    ends = isinstance(entry, dict) and all(isinstance(entry.get(key), str) for key in ("from", "to"))
    return ends and isinstance(entry.get("answer", {}), dict)

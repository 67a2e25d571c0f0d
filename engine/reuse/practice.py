"""Lookup before planning, learning after it."""

import time
from dataclasses import dataclass
from types import TracebackType

from engine import pipeline
from engine.macros.checking import check
from engine.macros.generalise import NotGeneral, generalise
from engine.macros.lookup import Hit
from engine.macros.query import Query, Situation, query
from engine.macros.repertoire import Repertoire
from engine.macros.world import Worlds
from engine.model.outcome import Found, Outcome, Statistics
from engine.planning import Limits
from engine.validation.semantics import Semantics
from kb.model.domain import Domain
from kb.model.plan import Plan
from kb.model.problem import Problem
from kb.store import Library
from kb.terms import ordered


@dataclass(frozen=True, slots=True)
class Answered:
    """An outcome and where it comes from: `library`, `planner`, or `state` when nothing was left to do.

    `macrop` is the number of the MACROP that was used, or of the one that was learned. `reason` says why a plan was not
    learned. `after` is the situation that the plan leads to, if it was executed.
    """

    outcome: Outcome
    origin: str
    macrop: int | None = None
    name: str = ""
    reason: str = ""
    after: Situation | None = None


class Practice:
    """A library at work. Problems of one cell share its statics; situations move on from plan to plan."""

    def __init__(self, library: Library, limits: Limits = Limits(), thorough: bool = False) -> None:
        """`thorough`: the independent checker looks at what lookup finds, too, not at what is planned alone."""
        self.library, self.limits, self.thorough = library, limits, thorough
        self._worlds = Worlds()
        self._repertoires: list[Repertoire] = []

    def __enter__(self) -> "Practice":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.flush()

    def flush(self) -> None:
        """Tell the library how often its MACROPs served."""
        for each in self._repertoires:
            each.flush()

    def repertoire(self, domain: Domain) -> Repertoire:
        """What the library holds for a domain."""
        found = next((each for each in self._repertoires if each.domain is domain), None)
        if found is None:
            found = Repertoire(self.library, domain)
            self._repertoires.append(found)
        return found

    def situation(self, problem: Problem) -> Situation:
        """The initial state of a problem, in its world."""
        return Situation.of(self._worlds.of(problem), Semantics(problem).initial())

    def plan(self, problem: Problem, situation: Situation | None = None) -> Answered:
        """A checked plan for a problem, from a situation if that is given, else from its own initial state.

        Raises `InvalidInput`.
        """
        here = situation if situation is not None else self.situation(problem)
        asked = query(problem, here)
        if asked is not None and asked.served:
            return Answered(Found(Plan(())), "state", after=here)
        found = self._looked_up(problem, asked) if asked is not None else None
        if found is not None:
            return found
        if situation is not None:
            problem = problem.replace(ordered(here.facts))
        return self._planned(problem, here, asked)

    def _looked_up(self, problem: Problem, asked: Query) -> Answered | None:
        started = time.perf_counter()
        hit = self.repertoire(problem.domain).find(asked)
        if hit is None or not self._approved(problem, asked.situation, hit):
            return None
        seconds = {"lookup": time.perf_counter() - started}
        outcome = Found(hit.plan, Statistics({}, seconds))
        assert isinstance(hit.key, int)
        return Answered(outcome, "library", hit.key, str(hit.macrop.name), after=hit.after)

    def _approved(self, problem: Problem, here: Situation, hit: Hit) -> bool:
        return not self.thorough or not pipeline.check_plan(problem.replace(ordered(here.facts)), hit.plan)

    def _planned(self, problem: Problem, here: Situation, asked: Query | None) -> Answered:
        started = time.perf_counter()
        outcome = pipeline.plan(problem, self.limits)
        seconds = time.perf_counter() - started
        if not isinstance(outcome, Found):
            return Answered(outcome, "planner")
        after = check(outcome.plan, asked) if asked is not None else None
        left = after if isinstance(after, Situation) else None
        try:
            learned = generalise(problem, outcome.plan, here.world, here.state).macrop
        except NotGeneral as error:
            return Answered(outcome, "planner", reason=str(error), after=left)
        number = self.repertoire(problem.domain).learn(learned, seconds)
        reason = "" if number is not None else "the library has it"
        return Answered(outcome, "planner", number, str(learned.name), reason, left)

"""Look problems up in a library before they are planned, and learn from their plans."""

import time
from dataclasses import dataclass, replace
from types import TracebackType

from cellwright.engine.model.forecast import makespan
from cellwright.engine.model.outcome import Found, Outcome, Statistics
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.gate import CELLS, PlanGate
from cellwright.engine.pipelines.reuse.composition import PlanPart, Served, compose, kinds_of, worth_composing
from cellwright.engine.pipelines.reuse.subsequences import Subsequences
from cellwright.engine.stages.grounding.initial import initial_state
from cellwright.engine.stages.grounding.program import Vocabulary
from cellwright.engine.stages.macros.learning.generalise import NotGeneral, generalise
from cellwright.engine.stages.macros.lifted.execution import executed
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lifted.world import CellDomains
from cellwright.engine.stages.macros.lookup.query import Query, query
from cellwright.engine.stages.macros.lookup.repertoire import Repertoire
from cellwright.engine.stages.planning import Limits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.macro import MacroPart
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.store import Library
from cellwright.kb.terms import ordered

LONG_SEARCH = 5_000  # a search of so many expansions is long: it is worth while to avoid it
LARGEST = 100  # the most steps of a plan that is learned: the time of generalising grows with their square
DEARER, LONGER = 1.05, 1.1  # the most that a composed plan may cost and last, relative to the planner's


@dataclass(frozen=True, slots=True)
class Answered:
    """An outcome, and where it comes from.

    `origin` is `library`, `planner`, `parts` (composed of MACROPs) or `state` (the goals hold already). `macrop` is the
    number of the MACROP that was used, or of the one that was learned. `reason` says why the plan was not learned. `after`
    is the situation that the plan leads to. It may be None if nothing is learned and the caller gave no situation.
    """

    outcome: Outcome
    origin: str
    macrop: int | None = None
    name: str = ""
    reason: str = ""
    after: Situation | None = None
    parts: tuple[PlanPart, ...] = ()


class Cells:
    """What was evaluated of the last few cells, by lookup and by the checker, each for itself. It serves any library."""

    def __init__(self, most: int = CELLS) -> None:
        self.worlds, self.gate = CellDomains(most), PlanGate(most)


class Practice:
    """A library in use.

    Problems of the same cell share its evaluated static facts. The situation after one plan can be the start of the next.
    """

    def __init__(
        self,
        library: Library,
        limits: Limits = Limits(),
        learns: bool = True,
        cells: Cells | None = None,
    ) -> None:
        """Without `learns`, the MACROPs of the library are used, and no new ones are learned. Some `cells` may be known already."""
        self.library, self.limits = library, limits
        self.learns = learns and library.writable
        self._cells = cells if cells is not None else Cells()
        self._repertoires: list[Repertoire] = []
        self._subsequences: list[Subsequences] = []

    def __enter__(self) -> "Practice":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.flush()

    def flush(self) -> None:
        """Write to the library how often its MACROPs were used."""
        for each in self._repertoires:
            each.flush()

    def repertoire(self, domain: Domain, known: Repertoire | None = None) -> Repertoire:
        """The MACROPs that the library holds for whole problems of a domain. They may be `known` already."""
        found = next((each for each in self._repertoires if each.domain is domain), None)
        if found is None:
            found = known.of_domain(domain) if known is not None else Repertoire(self.library, domain)
            self._repertoires.append(found)
        return found

    def subsequences(self, domain: Domain) -> Subsequences:
        """The MACROPs that the library holds for sub-sequences of plans of a domain."""
        found = next((each for each in self._subsequences if each.domain is domain), None)
        if found is None:
            found = Subsequences(self.library, domain)
            self._subsequences.append(found)
        return found

    def folded(self, problem: Problem, found: Answered) -> Answered:
        """An answer with the parts of its plan: the MACROPs that it is composed of, else the known sub-sequences in it."""
        if found.parts or not isinstance(found.outcome, Found):
            return found
        return replace(found, parts=self.subsequences(problem.domain).folded(found.outcome.plan))

    def situation(self, problem: Problem) -> Situation:
        """The initial state of a problem, with the static facts of its cell. Raises `InvalidInput` as grounding does."""
        state, contradicted = initial_state(problem, Vocabulary(problem.domain))
        if contradicted:
            raise InvalidInput(contradicted)
        return Situation.of(self._cells.worlds.of(problem), state)

    def plan(self, problem: Problem, situation: Situation | None = None) -> Answered:
        """A checked plan for a problem, from `situation` if one is given, else from the problem's initial state.

        Raises `InvalidInput`.
        """
        here = situation if situation is not None else self.situation(problem)
        found = self._known(problem, here)
        if found is not None:
            return found
        if situation is None:
            return self._planned(problem, here)
        found = self._planned(problem.replace(ordered(here.facts)), here)
        if found.after is None and isinstance(found.outcome, Found):
            found = replace(found, after=executed(found.outcome.plan, here))
        return found

    def _known(self, problem: Problem, here: Situation) -> Answered | None:
        """An answer without a search for the whole: nothing is left to do, or MACROPs solve the problem; else None."""
        asked = query(problem, here)
        if asked is None:
            return None
        if asked.served:
            fine = not here.world.violated and self._approved(problem, here, Plan(()))
            return Answered(Found(Plan(())), "state", after=here) if fine else None
        found = self._looked_up(problem, asked)
        if found is None and worth_composing(asked):
            found = self._composed_if_it_pays(problem, asked)
        return None if found is None or here.world.violated else found

    def _composed_if_it_pays(self, problem: Problem, asked: Query) -> Answered | None:
        """A composed plan, unless composing for such goals has failed more often than it has paid off.

        The first composed plan for such goals is compared with the planner's plan for the same problem. This trial is not
        made if nothing is to be learned.
        """
        kinds = " + ".join(sorted(kinds_of(asked)))
        successes, failures = self.library.trials(problem.domain.name, kinds)
        if failures > successes or not (successes or self.learns) or asked.world.violated:
            return None
        found = self._composed(problem, asked)
        if successes and (found is not None or not self.learns):
            return found
        here = problem.replace(ordered(asked.facts))
        rival, planning = self._searched(here, asked.situation)
        better = found is not None and _pays(found.outcome, rival)
        if found is None or not better:
            answer = self._learned(here, rival, planning, asked.situation)
        else:
            answer = self._learned_whole(problem, asked, found, planning)
        self.library.note_trial(
            problem.domain.name, kinds, better
        )  # last: who is killed before counts it once
        return answer

    def _learned_whole(self, problem: Problem, asked: Query, found: Answered, planning: float) -> Answered:
        """Keep the composed plan as a MACROP that contains others."""
        assert isinstance(found.outcome, Found)
        plan, here = found.outcome.plan, asked.situation
        if len(plan.steps) > LARGEST or not self.learns:
            return found
        try:
            whole = generalise(problem, plan, here.world, here.state).macrop
        except NotGeneral as error:
            return replace(found, reason=str(error))
        parts = tuple(MacroPart(part.name, part.steps) for part in found.parts)
        number = self.repertoire(problem.domain).learn(replace(whole, parts=parts), planning)
        return replace(found, macrop=number, name=str(whole.name))

    def _composed(self, problem: Problem, asked: Query) -> Answered | None:
        started = time.perf_counter()
        made = compose(problem, asked, self._serve)
        if made is None or not self._approved(problem, asked.situation, made.plan):
            return None
        seconds = {"composing": time.perf_counter() - started}
        return Answered(
            Found(made.plan, Statistics({}, seconds)), "parts", after=made.after, parts=made.parts
        )

    def _serve(self, part: Problem, here: Situation, may_plan: bool) -> Served | None:
        """A plan for one part from the library; if there is none, from the planner if its plan can be learned."""
        part = _alone(part)
        asked = query(part, here)
        if asked is None or asked.served:
            return None if asked is None else Served(Plan(()), None, here)
        answered = self._looked_up(part, asked, approve=False)
        if answered is None and not (may_plan and self.learns):
            return None
        planned = answered is None
        if answered is None:
            answered = self._planned(part.replace(ordered(here.facts)), here, whole=False)
        if not isinstance(answered.outcome, Found) or answered.after is None:
            return None
        return Served(answered.outcome.plan, answered.macrop, answered.after, planned, answered.name)

    def _looked_up(self, problem: Problem, asked: Query, approve: bool = True) -> Answered | None:
        started = time.perf_counter()
        hit = self.repertoire(problem.domain).find(asked)
        seconds = {"lookup": time.perf_counter() - started}
        if hit is None or (approve and not self._approved(problem, asked.situation, hit.plan)):
            return None
        seconds["check"] = time.perf_counter() - started - seconds["lookup"]
        outcome = Found(hit.plan, Statistics({}, seconds))
        assert isinstance(hit.key, int)
        parts = tuple(PlanPart(None, part.name, "", part.steps) for part in hit.macrop.parts)
        return Answered(outcome, "library", hit.key, str(hit.macrop.name), after=hit.after, parts=parts)

    def _approved(self, problem: Problem, here: Situation, plan: Plan) -> bool:
        """Whether the gate accepts a plan. If not, the plan is sought in the next way; the planner is the last one."""
        return not self._cells.gate.findings(problem, plan, here.state)

    def _planned(self, problem: Problem, here: Situation, whole: bool = True) -> Answered:
        outcome, seconds = self._searched(problem, here, whole)
        return self._learned(problem, outcome, seconds, here)

    def _searched(self, problem: Problem, here: Situation, whole: bool = True) -> tuple[Outcome, float]:
        """The planner's answer, and the seconds of the processor that it took.

        The planner may use known sub-sequences as operators. New ones are learned from plans for whole problems.
        """
        started = time.process_time()
        inner = self.subsequences(problem.domain)
        outcome, task = planning.planned(problem, self.limits, inner.offered())
        seconds = time.process_time() - started
        if self.learns and isinstance(outcome, Found) and not problem.domain.counts_fluents:
            inner.note(outcome.statistics)
            if whole:
                inner.study(problem, outcome.plan, task, here, self.limits.interrupted)
        return outcome, seconds

    def _learned(self, problem: Problem, outcome: Outcome, seconds: float, here: Situation) -> Answered:
        """The planner's answer, with what was learned from it."""
        if not isinstance(outcome, Found):
            return Answered(outcome, "planner")
        if not self.learns:
            idle = "learning is off" if self.library.writable else "the library may only be read"
            return Answered(outcome, "planner", reason=idle)
        left = executed(outcome.plan, here)
        if len(outcome.plan.steps) > LARGEST:
            return Answered(
                outcome,
                "planner",
                reason=f"{len(outcome.plan.steps)} steps are too many to learn",
                after=left,
            )
        try:
            learned = generalise(problem, outcome.plan, here.world, here.state).macrop
        except NotGeneral as error:
            return Answered(outcome, "planner", reason=str(error), after=left)
        number = self.repertoire(problem.domain).learn(learned, seconds)
        reason = "" if number is not None else self.library.loss or "the library has it already"
        return Answered(outcome, "planner", number, str(learned.name), reason, left)


def _alone(part: Problem) -> Problem:
    """A part without the waits of its chains for chains of other parts."""
    return replace(part, chains=tuple(replace(chain, after=()) for chain in part.chains))


def _pays(composed: Outcome, rival: Outcome) -> bool:
    """Whether a composed plan is worth while.

    It may be only a little dearer and longer than the planner's plan, and must be cheaper or avoid a long search. A search
    is long if it has many expansions. Its time does not count, so that the same input gives the same plan.
    """
    if not isinstance(rival, Found) or not isinstance(composed, Found):
        return True
    cost, other = composed.plan.cost, rival.plan.cost
    longer = makespan(composed.plan) > LONGER * makespan(rival.plan)
    long_search = rival.statistics.counts.get("expanded", 0) >= LONG_SEARCH
    return cost <= DEARER * other and not longer and (cost < other or long_search)

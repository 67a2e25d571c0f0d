"""The planner with a MACROP library: looks up, composes, learns; and keeps libraries open."""

import contextlib
import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found, Outcome, Statistics
from cellwright.engine.model.plan_times import plan_makespan
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.macros.cell_tasks import CellTasks
from cellwright.engine.pipelines.planning.macros.lookup_trials import LookupTrials
from cellwright.engine.pipelines.planning.macros.macro_composition import (
    PlanPart,
    ServedPart,
    compose_plan,
    signature_counts,
    worth_composing,
)
from cellwright.engine.pipelines.planning.macros.macro_subsequences import Subsequences
from cellwright.engine.pipelines.planning.plan_gate import MAX_KEPT_SEMANTICS, PlanGate
from cellwright.engine.stages.grounding.grounding_program import ChangingPredicates
from cellwright.engine.stages.grounding.initial_facts import initial_state
from cellwright.engine.stages.lifted.cell_domain import CellDomains, Situation
from cellwright.engine.stages.lifted.lifted_execution import final_situation
from cellwright.engine.stages.lifted.operator_schemas import NotGeneral
from cellwright.engine.stages.macros.learning.plan_generalisation import generalise_plan
from cellwright.engine.stages.macros.lookup.macro_query import (
    MacroQuery,
    make_query,
    signature_asked,
)
from cellwright.engine.stages.macros.lookup.macro_repertoire import MAX_READ_AHEAD, Repertoire
from cellwright.engine.stages.planning import NO_MACROS, Macros, SearchLimits
from cellwright.engine.stages.planning.landmark_cut import lower_bound
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.garbage_collection import search_now
from cellwright.kb.loader.problem_amounts import version_of_cell
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.plan_model import MacroPart, Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library
from cellwright.kb.store.database import note_opened
from cellwright.kb.store.lookup_counts import UNPAID
from cellwright.kb.terms import sort_naturally

LONG_SEARCH = 5_000  # a search of so many expansions is long: it is worth while to avoid it
# operators of a task that is planned at once, if it was grounded for another problem of its
# cell
SMALL = 1_000
SOON = 2_000  # expansions of a search that answers at once
# a reused plan that may cost more than so many times the least is compared with the planner's
RATIO = 1.1
# the most steps of a plan that is learned: the time of generalising grows with their square
MAX_LEARNED_STEPS = 100
# the most that a composed plan may cost and last, relative to the planner's
DEARER, LONGER = 1.05, 1.1


@dataclass(frozen=True, slots=True)
class LibraryAnswer:
    """An outcome, and where it comes from.

    `origin` is `library`, `planner`, `parts` (composed of MACROPs) or `state` (the goals hold
    already). `macrop` is the number of the MACROP that was used, or of the one that was learned.
    `reason` says why the plan was not learned. `after` is the situation that the plan leads to. It
    may be None if nothing is learned and the caller gave no situation. `priced` says that the cost
    of the MACROP that was used depends on what its variables stand for.
    """

    outcome: Outcome
    origin: str
    macrop: int | None = None
    name: str = ""
    reason: str = ""
    after: Situation | None = None
    parts: tuple[PlanPart, ...] = ()
    priced: bool = False


class EvaluatedCells:
    """What was evaluated of the last few cells, by lookup and by the checker, each for itself.

    It serves any library.
    """

    def __init__(self, most: int = MAX_KEPT_SEMANTICS) -> None:
        self.worlds, self.gate, self.tasks = CellDomains(most), PlanGate(most), CellTasks()
        self._domains: list[Domain] = []

    def in_known_domain(self, problem: Problem) -> Problem:
        """The problem with the domain that equals its own, if that was read before: what is
        known of it serves again.
        """
        domain = next((each for each in self._domains if each == problem.domain), None)
        if domain is None:
            self._domains = [problem.domain, *self._domains[: MAX_KEPT_SEMANTICS - 1]]
            return problem
        return problem if domain is problem.domain else replace(problem, domain=domain)


class LibraryPlanner:
    """A library in use.

    Problems of the same cell share its evaluated static facts. The situation after one plan can be
    the start of the next.
    """

    def __init__(
        self,
        library: Library,
        limits: SearchLimits = SearchLimits(),
        learns: bool = True,
        cells: EvaluatedCells | None = None,
        ratio: float = RATIO,
    ) -> None:
        """Without `learns`, the MACROPs of the library are used, and no new ones are learned. Some
        `cells` may be known already.

        If a reused plan is not known to cost at most `ratio` times the least, the planner is asked
        as well.
        """
        self.library, self.limits, self.ratio = library, limits, ratio
        self.learns = learns and library.writable
        self._cells = cells if cells is not None else EvaluatedCells()
        self._repertoires: list[Repertoire] = []
        self._subsequences: list[Subsequences] = []
        self._trials: dict[str, LookupTrials] = {}

    def __enter__(self) -> "LibraryPlanner":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.flush()

    def flush(self) -> None:
        """Write to the library how often its MACROPs were used."""
        for repertoire in self._repertoires:
            repertoire.flush()

    def repertoire(self, domain: Domain, known: Repertoire | None = None) -> Repertoire:
        """The MACROPs that the library holds for whole problems of a domain.

        They may be `known` already.
        """
        repertoire = next(
            (
                known_repertoire
                for known_repertoire in self._repertoires
                if known_repertoire.domain == domain
            ),
            None,
        )
        if repertoire is None:
            repertoire = (
                known.of_domain(domain) if known is not None else Repertoire(self.library, domain)
            )
            self._repertoires.append(repertoire)
        return repertoire

    def trials(self, domain: Domain) -> LookupTrials:
        """What the library has experienced with lookups for a domain."""
        return self._trials.setdefault(domain.name, LookupTrials(self.library, domain.name))

    def subsequences(self, domain: Domain) -> Subsequences:
        """The MACROPs that the library holds for sub-sequences of plans of a domain."""
        subsequences = next(
            (
                known_subsequences
                for known_subsequences in self._subsequences
                if known_subsequences.domain == domain
            ),
            None,
        )
        if subsequences is None:
            subsequences = Subsequences(self.library, domain)
            self._subsequences.append(subsequences)
        return subsequences

    def folded(self, problem: Problem, answer: LibraryAnswer) -> LibraryAnswer:
        """An answer with the parts of its plan: the MACROPs that it is composed of, else the
        known sub-sequences in it.
        """
        if answer.parts or not isinstance(answer.outcome, Found):
            return answer
        return replace(answer, parts=self.subsequences(problem.domain).folded(answer.outcome.plan))

    def situation(self, problem: Problem) -> Situation:
        """The initial state of a problem, with the static facts of its cell.

        Raises `InvalidInput` as grounding does.
        """
        state, contradicted = initial_state(problem, ChangingPredicates(problem.domain))
        if contradicted:
            raise InvalidInput(contradicted)
        return Situation.of(self._cells.worlds.of(problem), state)

    def plan(self, problem: Problem, situation: Situation | None = None) -> LibraryAnswer:
        """A checked plan for a problem, from `situation` if one is given, else from the problem's
        initial state.

        Raises `InvalidInput`.
        """
        if situation is None:
            problem = self._cells.in_known_domain(problem)
        start = situation if situation is not None else self.situation(problem)
        asked = make_query(problem, start)
        if asked is not None and asked.served:
            fine = not start.world.violated and self._approved(problem, start, Plan(()))
            return (
                LibraryAnswer(Found(Plan(())), "state", after=start)
                if fine
                else self._planned(problem, start)
            )
        before = problem if situation is None else problem.replace(sort_naturally(start.facts))
        answer = self._reused_or_planned(before, start, asked)
        if situation is not None and answer.after is None and isinstance(answer.outcome, Found):
            answer = replace(answer, after=final_situation(answer.outcome.plan, start))
        return answer

    def _reused_or_planned(
        self, problem: Problem, here: Situation, asked: MacroQuery | None
    ) -> LibraryAnswer:
        """The plan of a lookup, if one is made and nothing says that it is dear; else the better
        one of this and the planner's.
        """
        kind, trials = (
            signature_asked(asked) if asked is not None else "",
            self.trials(problem.domain),
        )
        if asked is None or here.world.violated:
            return self._planned(problem, here)
        if not trials.pays(kind):
            return self._planned_at_once(problem, here) or self._planned_after_all(
                problem, here, kind
            )
        hit = self._looked_up(problem, asked)
        if hit is not None and self._is_good(problem, here, kind, hit):
            return hit
        if hit is None and worth_composing(asked):
            composed = self._composed_if_it_pays(problem, asked)
            if composed is not None:
                return composed
        return self._compared(problem, asked, kind, hit)

    def _is_good(self, problem: Problem, here: Situation, kind: str, hit: LibraryAnswer) -> bool:
        """Whether a reused plan answers without the planner.

        Its cost is at most `ratio` times a lower bound, if a task that is known tells one. Else
        plans of this cost must have been good for such goals before; what costs more in other
        places is compared each time.
        """
        trials = self.trials(problem.domain)
        task = self._cells.tasks.task_of(problem, here)
        cost = hit.outcome.plan.cost if isinstance(hit.outcome, Found) else 0
        if task is not None:
            good = cost <= self.ratio * lower_bound(task, enough=math.ceil(cost / self.ratio))
        else:
            good = not hit.priced and trials.is_trusted(kind, cost)
        if good:
            pays = task is None or len(task.operators) > SMALL
            self._note(lambda: trials.note_lookup(kind, pays))
        return good

    def _compared(
        self, problem: Problem, asked: MacroQuery, kind: str, hit: LibraryAnswer | None
    ) -> LibraryAnswer:
        """The planner's answer, or a reused plan that costs no more."""
        trials, here = self.trials(problem.domain), asked.situation
        outcome, seconds = self._searched(problem, here)
        little = checked_plan.is_little_work(outcome)
        if hit is not None:
            good = _costs_at_most(hit.outcome, outcome, self.ratio)
            cost = hit.outcome.plan.cost if isinstance(hit.outcome, Found) else 0
            self._note(lambda: trials.note_quality(kind, cost, good))
            self._note(lambda: trials.note_lookup(kind, not little or (good and not hit.priced)))
            if _costs_at_most(hit.outcome, outcome, 1.0):
                return hit
        elif self.repertoire(problem.domain).has(asked):
            self._note(lambda: trials.note_lookup(kind, not little))
        return self._learned(problem, outcome, seconds, here)

    def _planned_at_once(self, problem: Problem, here: Situation) -> LibraryAnswer | None:
        """A plan for a small task that was grounded before, if a search finds one at once."""
        task = self._small_task(problem, here)
        if task is None:
            return None
        limits = replace(self.limits, expansions=min(self.limits.expansions, SOON))
        before = problem.replace(sort_naturally(here.facts))
        found = checked_plan.planned_on(before, task, limits, NO_MACROS, self._cells.gate)
        return LibraryAnswer(found, "planner", reason=UNPAID) if isinstance(found, Found) else None

    def _planned_after_all(self, problem: Problem, here: Situation, kind: str) -> LibraryAnswer:
        """The planner's answer where lookups have not paid. If it has much to do, they are worth
        while after all.
        """
        outcome, seconds = self._searched(problem, here, whole=False)
        if checked_plan.is_little_work(outcome):
            return LibraryAnswer(outcome, "planner", reason=UNPAID)
        self._note(lambda: self.trials(problem.domain).note_lookup(kind, True))
        return self._learned(problem, outcome, seconds, here)

    def _small_task(self, problem: Problem, here: Situation) -> GroundTask | None:
        """The ground task of a problem, if it is small, and another problem of its cell was
        grounded before.
        """
        task = self._cells.tasks.task_of(problem, here)
        return task if task is not None and len(task.operators) <= SMALL else None

    def _note(self, count: Callable[[], None]) -> None:
        if self.learns:
            count()

    def _composed_if_it_pays(self, problem: Problem, asked: MacroQuery) -> LibraryAnswer | None:
        """A composed plan, unless composing for such goals has failed more often than it has paid
        off.

        The first composed plan for such goals is compared with the planner's plan for the same
        problem. This trial is not made if nothing is to be learned.
        """
        kinds = " + ".join(sorted(signature_counts(asked)))
        successes, failures = self.library.trials(problem.domain.name, kinds)
        if failures > successes or not (successes or self.learns) or asked.world.violated:
            return None
        composed_answer = self._composed(problem, asked)
        if successes and (composed_answer is not None or not self.learns):
            return composed_answer
        state_problem = problem.replace(sort_naturally(asked.facts))
        rival, planning = self._searched(state_problem, asked.situation)
        better = composed_answer is not None and _composition_pays(composed_answer.outcome, rival)
        if composed_answer is None or not better:
            answer = self._learned(state_problem, rival, planning, asked.situation)
        else:
            answer = self._learned_whole(problem, asked, composed_answer, planning)
        self.library.note_trial(
            problem.domain.name, kinds, better
        )  # last: who is killed before counts it once
        return answer

    def _learned_whole(
        self, problem: Problem, asked: MacroQuery, answer: LibraryAnswer, planning: float
    ) -> LibraryAnswer:
        """Keep the composed plan as a MACROP that contains others."""
        assert isinstance(answer.outcome, Found)
        plan, start = answer.outcome.plan, asked.situation
        if len(plan.steps) > MAX_LEARNED_STEPS or not self.learns:
            return answer
        try:
            whole = generalise_plan(problem, plan, start.world, start.state).macrop
        except NotGeneral as error:
            return replace(answer, reason=str(error))
        parts = tuple(MacroPart(part.name, part.steps) for part in answer.parts)
        number = self.repertoire(problem.domain).learn(replace(whole, parts=parts), planning)
        return replace(answer, macrop=number, name=str(whole.name))

    def _composed(self, problem: Problem, asked: MacroQuery) -> LibraryAnswer | None:
        started = time.perf_counter()
        composed_plan = compose_plan(problem, asked, self._serve)
        if composed_plan is None or not self._approved(
            problem, asked.situation, composed_plan.plan
        ):
            return None
        seconds = {"composing": time.perf_counter() - started}
        return LibraryAnswer(
            Found(composed_plan.plan, Statistics({}, seconds)),
            "parts",
            after=composed_plan.after,
            parts=composed_plan.parts,
        )

    def _serve(self, part: Problem, start: Situation, may_plan: bool) -> ServedPart | None:
        """A plan for one part from the library; if there is none, from the planner if its plan
        can be learned.
        """
        part = _without_waits(part)
        asked = make_query(part, start)
        if asked is None or asked.served:
            return None if asked is None else ServedPart(Plan(()), None, start)
        answered = self._looked_up(part, asked, approve=False)
        if answered is None and not (may_plan and self.learns):
            return None
        planned = answered is None
        if answered is None:
            answered = self._planned(part.replace(sort_naturally(start.facts)), start, whole=False)
        if not isinstance(answered.outcome, Found) or answered.after is None:
            return None
        return ServedPart(
            answered.outcome.plan, answered.macrop, answered.after, planned, answered.name
        )

    def _looked_up(
        self, problem: Problem, asked: MacroQuery, approve: bool = True
    ) -> LibraryAnswer | None:
        started = time.perf_counter()
        hit = self.repertoire(problem.domain).find(asked)
        seconds = {"lookup": time.perf_counter() - started}
        if hit is None or (approve and not self._approved(problem, asked.situation, hit.plan)):
            return None
        seconds["check"] = time.perf_counter() - started - seconds["lookup"]
        outcome = Found(hit.plan, Statistics({}, seconds))
        assert isinstance(hit.key, int)
        all_steps = len(hit.plan.steps) == len(hit.macrop.steps)
        parts = tuple(PlanPart(None, p.name, "", p.steps) for p in hit.macrop.parts if all_steps)
        name, priced = str(hit.macrop.name), hit.macrop.cost is None
        return LibraryAnswer(
            outcome, "library", hit.key, name, after=hit.after, parts=parts, priced=priced
        )

    def _approved(self, problem: Problem, start: Situation, plan: Plan) -> bool:
        """Whether the gate accepts a plan.

        If not, the plan is sought in the next way; the planner is the last one.
        """
        return not self._cells.gate.findings(problem, plan, start.state)

    def _planned(self, problem: Problem, start: Situation, whole: bool = True) -> LibraryAnswer:
        outcome, seconds = self._searched(problem, start, whole)
        return self._learned(problem, outcome, seconds, start)

    def _searched(
        self, problem: Problem, start: Situation, whole: bool = True
    ) -> tuple[Outcome, float]:
        """The planner's answer, and the seconds of the processor that it took.

        The planner may use known sub-sequences as operators. New ones are learned from plans for
        whole problems.
        """
        started = time.process_time()
        inner = self.subsequences(problem.domain)
        outcome, task = self._asked(problem, start, inner.offered())
        seconds = time.process_time() - started
        if self.learns and isinstance(outcome, Found) and not problem.domain.counts_fluents:
            inner.note(outcome.statistics)
            if whole:
                inner.study(problem, outcome.plan, task, start, self.limits.interrupted)
        return outcome, seconds

    def _asked(
        self, problem: Problem, here: Situation, macros: Macros
    ) -> tuple[Outcome, GroundTask]:
        """The planner's answer and its task. What was grounded in the same cell before is not
        grounded anew.
        """
        cells, limits = self._cells, self.limits
        before = problem.replace(sort_naturally(here.facts))
        task = cells.tasks.task_of(before, here)
        if task is not None and not here.world.violated:
            answer = checked_plan.planned_on(before, task, limits, macros, cells.gate)
            if answer is not None:
                return answer, task
        whole = cells.tasks.leaves_nothing_out(problem)
        outcome, task = checked_plan.plan_and_ground(
            before, limits, macros, whole=whole, gate=cells.gate
        )
        cells.tasks.keep(problem, task)
        return outcome, task

    def _learned(
        self, problem: Problem, outcome: Outcome, seconds: float, start: Situation
    ) -> LibraryAnswer:
        """The planner's answer, with what was learned from it."""
        if not isinstance(outcome, Found):
            return LibraryAnswer(outcome, "planner")
        if not self.learns:
            idle = "learning is off" if self.library.writable else "the library may only be read"
            return LibraryAnswer(outcome, "planner", reason=idle)
        end = final_situation(outcome.plan, start)
        if len(outcome.plan.steps) > MAX_LEARNED_STEPS:
            return LibraryAnswer(
                outcome,
                "planner",
                reason=f"{len(outcome.plan.steps)} steps are too many to learn",
                after=end,
            )
        try:
            learned = generalise_plan(problem, outcome.plan, start.world, start.state).macrop
        except NotGeneral as error:
            return LibraryAnswer(outcome, "planner", reason=str(error), after=end)
        number = self.repertoire(problem.domain).learn(learned, seconds)
        reason = "" if number is not None else self.library.loss or "the library has it already"
        return LibraryAnswer(outcome, "planner", number, str(learned.name), reason, end)


def _costs_at_most(reused: Outcome, rival: Outcome, ratio: float) -> bool:
    """Whether a reused plan costs at most so many times what the planner's plan does."""
    if not isinstance(rival, Found):
        return True
    return isinstance(reused, Found) and reused.plan.cost <= ratio * rival.plan.cost


def _without_waits(part: Problem) -> Problem:
    """A part without the waits of its chains for chains of other parts."""
    return replace(part, chains=tuple(replace(chain, after=()) for chain in part.chains))


def _composition_pays(composed: Outcome, rival: Outcome) -> bool:
    """Whether a composed plan is worth while.

    It may be only a little dearer and longer than the planner's plan, and must be cheaper or avoid
    a long search. A search is long if it has many expansions. Its time does not count, so that the
    same input gives the same plan.
    """
    if not isinstance(rival, Found) or not isinstance(composed, Found):
        return True
    cost, rival_cost = composed.plan.cost, rival.plan.cost
    longer = plan_makespan(composed.plan) > LONGER * plan_makespan(rival.plan)
    long_search = rival.statistics.counts.get("expanded", 0) >= LONG_SEARCH
    return cost <= DEARER * rival_cost and not longer and (cost < rival_cost or long_search)


MAX_OPEN_LIBRARIES = 4  # libraries and domains that a thread keeps
MAX_OUTLINES = 20_000  # MACROPs of a domain; above that its outlines are not kept
FIRST_READ_MACROPS = 8  # MACROPs that are read ahead at first
MAX_LIBRARY_CELLS = 2  # cells whose evaluated facts are kept with a library


@dataclass(frozen=True, slots=True)
class _OpenLibrary:
    """A library that stays open, with what is known of a domain, and of its cells as long as the
    file of places has its `version`.

    `known` says what the library held, see `Library.holdings`.
    """

    store: str
    file: tuple[int, int] | None
    library: Library
    repertoire: Repertoire
    known: tuple[int, int, str]
    cells: EvaluatedCells | None = None
    version: tuple[Path, int, int] | None = None

    def serves(self, store: str, domain: Domain) -> bool:
        """Whether it is the library of a store for a domain."""
        own = self.repertoire.domain
        return self.store == store and (own is domain or own == domain)

    def is_true(self) -> bool:
        """Whether all that was known is still there."""
        holdings = self.library.holdings(self.repertoire.domain.name, self.known[1])
        return self.file == _store_identity(self.store) and holdings == self.known


@dataclass
class _OpenLibraries(threading.local):
    """What a thread keeps: the latest last.

    `asked` are the stores for which it has planned once.
    """

    standing: list[_OpenLibrary] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)


_OPEN = _OpenLibraries()
_INHERITED_LIBRARIES: list[
    list[_OpenLibrary]
] = []  # connections of a parent process: never used, never closed


def _begin_apart() -> None:
    _INHERITED_LIBRARIES.append(_OPEN.standing)
    _OPEN.standing = []


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_apart)


@contextlib.contextmanager
def open_planner(store: str, domain: Domain, limits: SearchLimits) -> Iterator[LibraryPlanner]:
    """A library in use for one problem of a domain; it stays open if the process has asked before.

    Raises `InvalidInput`.
    """
    own, version = _take_open(store, domain), version_of_cell(domain)
    cells = (
        own.cells
        if own and own.cells and own.version == version
        else EvaluatedCells(MAX_LIBRARY_CELLS)
    )
    with contextlib.ExitStack() as closing:
        library = closing.enter_context(own.library if own else Library(store, beside=True))
        note_opened(store)
        with LibraryPlanner(library, limits, cells=cells) as practice:
            repertoire = practice.repertoire(domain, own.repertoire if own else None)
            yield practice
        if store not in _OPEN.asked:
            _OPEN.asked = [*_OPEN.asked[1 - MAX_OPEN_LIBRARIES :], store]
        elif library.writable and not (library.loss or store.startswith("sqlite:")):
            with contextlib.suppress(
                InvalidInput
            ):  # the answer is there; next time the library is opened anew
                opened = own or _open_library(store, library, repertoire.domain)
                if _keep_open(replace(opened, cells=cells, version=version)):
                    closing.pop_all()


def close_libraries() -> None:
    """Close the libraries that this thread keeps open, and forget that it asked."""
    for library in _OPEN.standing:
        library.library.close()
    _OPEN.standing, _OPEN.asked = [], []


def _take_open(store: str, domain: Domain) -> _OpenLibrary | None:
    """The library that stays open for a domain, if what it knows is still true; nobody else has
    it meanwhile.
    """
    library = next(
        (open_library for open_library in _OPEN.standing if open_library.serves(store, domain)),
        None,
    )
    if library is None:
        return None
    _OPEN.standing = [
        open_library for open_library in _OPEN.standing if open_library is not library
    ]
    with contextlib.ExitStack() as closing:
        closing.callback(library.library.close)
        with contextlib.suppress(InvalidInput):  # who opens it anew hears why
            if library.is_true():
                closing.pop_all()
                return library
    return None


def _open_library(store: str, library: Library, domain: Domain) -> _OpenLibrary:
    """A library with the outlines as they are now: those that a problem has used may have been
    removed since.
    """
    file, holdings = _store_identity(store), library.holdings(domain.name)
    repertoire = Repertoire(library, domain)
    if holdings[0] <= MAX_OUTLINES:
        repertoire.load()
    return _OpenLibrary(store, file, library, repertoire, holdings)


def _keep_open(own: _OpenLibrary) -> bool:
    """Keep a library open, with more MACROPs read; whether it is kept."""
    repertoire = own.repertoire
    if repertoire.newest > own.known[1]:
        holdings = own.library.holdings(repertoire.domain.name)
        if not own.is_true():
            return False
        own = replace(own, known=holdings)
    if own.known[0] > MAX_OUTLINES or repertoire.read > 2 * MAX_READ_AHEAD:
        return False
    if repertoire.read_ahead(
        min(
            max(FIRST_READ_MACROPS, repertoire.read),
            MAX_READ_AHEAD - min(MAX_READ_AHEAD, repertoire.read),
        )
    ):
        search_now()
    _OPEN.standing.append(own)
    while len(_OPEN.standing) > MAX_OPEN_LIBRARIES:
        _OPEN.standing.pop(0).library.close()
    return True


def _store_identity(store: str) -> tuple[int, int] | None:
    """Which file a store is, whatever its name; None for a server or no file."""
    try:
        file_status = None if "://" in store else Path(store).expanduser().stat()
    except (OSError, RuntimeError, ValueError):
        return None
    return (file_status.st_dev, file_status.st_ino) if file_status else None

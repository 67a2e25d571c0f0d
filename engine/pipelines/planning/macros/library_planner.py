"""The planner with a MACROP library: looks up, composes, learns; and keeps libraries open."""

import contextlib
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType

from cellwright.engine.model.outcome import Found, Outcome, Statistics
from cellwright.engine.model.plan_times import plan_makespan
from cellwright.engine.pipelines.planning import checked_plan
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
from cellwright.engine.stages.macros.lookup.macro_query import MacroQuery, make_query
from cellwright.engine.stages.macros.lookup.macro_repertoire import MAX_READ_AHEAD, Repertoire
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.cycles import search_now
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.problem_amounts import version_of_cell
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.plan_model import MacroPart, Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library
from cellwright.kb.store.database import note_opened
from cellwright.kb.terms import sort_naturally

LONG_SEARCH = 5_000  # a search of so many expansions is long: it is worth while to avoid it
MAX_LEARNED_STEPS = (
    # the most steps of a plan that is learned: the time of generalising grows with their square
    100
)
# the most that a composed plan may cost and last, relative to the planner's
DEARER, LONGER = 1.05, 1.1


@dataclass(frozen=True, slots=True)
class LibraryAnswer:
    """An outcome, and where it comes from.

    `origin` is `library`, `planner`, `parts` (composed of MACROPs) or `state` (the goals hold
    already). `macrop` is the number of the MACROP that was used, or of the one that was learned.
    `reason` says why the plan was not learned. `after` is the situation that the plan leads to. It
    may be None if nothing is learned and the caller gave no situation.
    """

    outcome: Outcome
    origin: str
    macrop: int | None = None
    name: str = ""
    reason: str = ""
    after: Situation | None = None
    parts: tuple[PlanPart, ...] = ()


class EvaluatedCells:
    """What was evaluated of the last few cells, by lookup and by the checker, each for itself.

    It serves any library.
    """

    def __init__(self, most: int = MAX_KEPT_SEMANTICS) -> None:
        self.worlds, self.gate = CellDomains(most), PlanGate(most)


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
    ) -> None:
        """Without `learns`, the MACROPs of the library are used, and no new ones are learned.

        Some `cells` may be known already.
        """
        self.library, self.limits = library, limits
        self.learns = learns and library.writable
        self._cells = cells if cells is not None else EvaluatedCells()
        self._repertoires: list[Repertoire] = []
        self._subsequences: list[Subsequences] = []

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
                if known_repertoire.domain is domain
            ),
            None,
        )
        if repertoire is None:
            repertoire = (
                known.of_domain(domain) if known is not None else Repertoire(self.library, domain)
            )
            self._repertoires.append(repertoire)
        return repertoire

    def subsequences(self, domain: Domain) -> Subsequences:
        """The MACROPs that the library holds for sub-sequences of plans of a domain."""
        subsequences = next(
            (
                known_subsequences
                for known_subsequences in self._subsequences
                if known_subsequences.domain is domain
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
        start = situation if situation is not None else self.situation(problem)
        answer = self._known(problem, start)
        if answer is not None:
            return answer
        if situation is None:
            return self._planned(problem, start)
        answer = self._planned(problem.replace(sort_naturally(start.facts)), start)
        if answer.after is None and isinstance(answer.outcome, Found):
            answer = replace(answer, after=final_situation(answer.outcome.plan, start))
        return answer

    def _known(self, problem: Problem, start: Situation) -> LibraryAnswer | None:
        """An answer without a search for the whole: nothing is left to do, or MACROPs solve the
        problem; else None.
        """
        asked = make_query(problem, start)
        if asked is None:
            return None
        if asked.served:
            fine = not start.world.violated and self._approved(problem, start, Plan(()))
            return LibraryAnswer(Found(Plan(())), "state", after=start) if fine else None
        answer = self._looked_up(problem, asked)
        if answer is None and worth_composing(asked):
            answer = self._composed_if_it_pays(problem, asked)
        return None if answer is None or start.world.violated else answer

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
        parts = tuple(PlanPart(None, part.name, "", part.steps) for part in hit.macrop.parts)
        return LibraryAnswer(
            outcome, "library", hit.key, str(hit.macrop.name), after=hit.after, parts=parts
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
        outcome, task = checked_plan.plan_and_ground(problem, self.limits, inner.offered())
        seconds = time.process_time() - started
        if self.learns and isinstance(outcome, Found) and not problem.domain.counts_fluents:
            inner.note(outcome.statistics)
            if whole:
                inner.study(problem, outcome.plan, task, start, self.limits.interrupted)
        return outcome, seconds

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

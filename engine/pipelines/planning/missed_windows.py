"""Finds time windows and due times that no plan can keep, because nobody can be there so early.

The earliest time of a fact is that of its quickest step, after the latest of what the step needs
(Haslum & Geffner 2001). Steps may overlap, so no plan is sooner.
"""

from collections.abc import Iterable, Iterator, Mapping
from heapq import heappop, heappush

from cellwright.engine.kernels.bits import indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.workflow_replay import stage_atom
from cellwright.engine.pipelines.planning.window_proofs import find_windows_too_short
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.check.physics import place_of_fact
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number, Term


def find_missed_windows(problem: Problem, task: GroundTask) -> Iterator[Diagnostic]:
    """Warnings about windows and due times of a problem that no plan keeps."""
    yield from _windows_too_short(problem, task)
    words = problem.domain.conventions
    if not {words.window, words.due} & set(problem.domain.predicates):
        return
    facts = evaluate_statics(problem)
    windows, dues = list(facts.atoms(words.window, 3)), list(facts.atoms(words.due, 2))
    if not (windows or dues):
        return
    earliest = _Earliest(task, dict(_times(facts.atoms(words.release, 2))))
    for thing, first, last in windows:
        begin = earliest.begin_of(words.measured, thing)
        if isinstance(last, Number) and begin is not None and begin > last.value:
            fact = Function(words.window, (thing, first, last))
            yield _missed_window(problem, fact, f"no plan can begin it before {begin}")
    for thing, last in dues:
        ends = [
            earliest.end_of(stage_atom(chain, len(chain.stages)))
            for chain in problem.chains
            if chain.wanted and chain.subject == thing
        ]
        end = max((each for each in ends if each is not None), default=0)
        if isinstance(last, Number) and end > last.value:
            yield _missed_window(
                problem, Function(words.due, (thing, last)), f"its stages take until {end} at least"
            )


def _windows_too_short(problem: Problem, task: GroundTask) -> Iterator[Diagnostic]:
    for lag in find_windows_too_short(problem, task) if problem.all_windows else ():
        message = f"a window cannot be kept: {lag.text(problem.domain.time_unit)}"
        hint = "give it more time, or a price"
        yield Diagnostic(lag.breach.window.where, "K319", message, hint, warning=True)


def _missed_window(problem: Problem, fact: Atom, why: str) -> Diagnostic:
    hint = "give it more time; times count from the start"
    return Diagnostic(
        place_of_fact(problem, fact), "K319", f"{fact} cannot be kept: {why}", hint, warning=True
    )


def _times(facts: Iterable[tuple[Term, ...]]) -> Iterator[tuple[Term, int]]:
    for thing, time in facts:
        if isinstance(time, Number):
            yield thing, time.value


def _about(atom: Atom, thing: Term) -> bool:
    """Whether an atom speaks of a thing, as an argument or inside of one."""
    return any(
        each == thing or (isinstance(each, Function) and _about(each, thing))
        for each in atom.arguments
    )


class _Earliest:
    """The earliest time of each atom of a task, if steps may overlap as they like."""

    def __init__(self, task: GroundTask, released: Mapping[Term, int]) -> None:
        self.task, self.released = task, released
        derived = task.axioms.derived if task.axioms else 0
        self.at: dict[int, int] = dict.fromkeys(indices(task.initial), 0)
        self.at |= dict.fromkeys(indices(derived), 0)
        self.numbers = {atom: number for number, atom in enumerate(task.atoms)}
        self._spread()

    def begin_of(self, name: str, thing: Term) -> int | None:
        """The earliest begin of a step that adds a fact of this name about a thing; None if it
        holds, or no step adds it.
        """
        numbers = {
            number
            for atom, number in self.numbers.items()
            if atom.name == name and _about(atom, thing)
        }
        if any(self.task.initial >> number & 1 for number in numbers):
            return None
        begins = (
            self._begin(each)
            for each in self.task.operators
            if numbers & set(indices(_added_atoms(each)))
        )
        return min((each for each in begins if each is not None), default=None)

    def end_of(self, atom: Atom) -> int | None:
        """The earliest time of an atom; None if it is never true."""
        return self.at.get(self.numbers.get(atom, -1))

    def _begin(self, operator: GroundOperator) -> int | None:
        times = [self.at.get(each) for each in indices(operator.preconditions)]
        if None in times:
            return None
        begin = max((each for each in times if each is not None), default=0)
        return max([begin, *(self.released.get(each, 0) for each in operator.resources)])

    def _spread(self) -> None:
        operators = self.task.operators
        lacking = [each.preconditions.bit_count() for each in operators]
        users: dict[int, list[int]] = {}
        for number, operator in enumerate(operators):
            for atom in indices(operator.preconditions):
                users.setdefault(atom, []).append(number)
        queue, done = [(0, atom) for atom in self.at], set[int]()
        ready = [number for number, count in enumerate(lacking) if not count]
        while ready or queue:
            for number in ready:
                self._apply(operators[number], queue)
            ready = []
            if queue and (atom := heappop(queue)[1]) not in done:
                done.add(atom)
                for number in users.get(atom, ()):
                    lacking[number] -= 1
                    ready += [] if lacking[number] else [number]

    def _apply(self, operator: GroundOperator, queue: list[tuple[int, int]]) -> None:
        """Note when an operator makes its effects true, if that is sooner than known."""
        end = (self._begin(operator) or 0) + operator.duration
        for atom in indices(_added_atoms(operator)):
            if end < self.at.get(atom, end + 1):
                self.at[atom] = end
                heappush(queue, (end, atom))


def _added_atoms(operator: GroundOperator) -> int:
    found = operator.adds
    for effect in operator.conditional:
        found |= effect.adds
    return found

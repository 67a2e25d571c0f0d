"""The reachable action instances and atoms of a problem in time, if nothing ever became false;
computed by clingo.

The start of an instance comes before its end: what only the end needs may be a consequence of the
start, as where an action spans all that must be done within a time.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cellwright.kb.asp import Grounder
from cellwright.kb.graphs import strong_components
from cellwright.kb.model.conditions import And, Comparison, Condition, Literal, goal_parts
from cellwright.kb.model.durative import DurativeAction, Moment, TemporalProblem, TimedEffect
from cellwright.kb.terms import Atom, Function, Term, Variable


@dataclass(frozen=True)
class Reached:
    """For each action its bindings, as numbers of objects; for each predicate its atoms, in the
    same way.
    """

    instances: tuple[list[tuple[int, ...]], ...]
    atoms: frozenset[Atom]
    objects: tuple[str, ...]


def reach(problem: TemporalProblem) -> Reached:
    """All that can be reached in a problem."""
    objects = tuple(problem.objects)
    program = _Program(problem, {name: number for number, name in enumerate(objects)})
    grounder = Grounder()
    grounder.ground("\n".join(program.text()))
    arities = {f"a{index}": len(action.parameters) for index, action in enumerate(problem.actions)}
    predicates = {name: arity for name, arity in program.arities.items() if name.startswith("f")}
    tables = grounder.tables(arities | predicates)
    instances = tuple(
        [tuple(row) for row in tables[f"a{index}"]] for index in range(len(problem.actions))
    )
    atoms = frozenset(
        Function(name.partition("_")[2], tuple(Function(objects[number]) for number in row))
        for name in predicates
        for row in tables[name]
    )
    return Reached(instances, atoms, objects)


class _Program:
    def __init__(self, problem: TemporalProblem, numbers: dict[str, int]) -> None:
        self.problem, self.numbers = problem, numbers
        self.arities: dict[str, int] = {}
        self.mutual = mutual_predicates(problem.actions)

    def text(self) -> Iterator[str]:
        """The statements: types, facts, instances and what they add."""
        for name, types in self.problem.objects.items():
            yield from (f"t_{type_}({self.numbers[name]})." for type_ in sorted(types))
        for atom in sorted(self.problem.initial, key=str):
            yield f"{self._atom(atom)}."
        for change in self.problem.changes:
            if isinstance(change.change, Literal) and change.change.positive:
                yield f"{self._atom(change.change.atom)}."
        for index, action in enumerate(self.problem.actions):
            yield from self._action(index, action)
        defined = sorted({f"{name}/{arity}" for name, arity in self.arities.items()})
        yield from (f"#defined {name}." for name in defined)
        used = sorted({p.type for action in self.problem.actions for p in action.parameters})
        yield from (f"#defined t_{type_}/1." for type_ in used)

    def _atom(self, atom: Atom) -> str:
        name = f"f{len(atom.arguments)}_{atom.name}"
        self.arities[name] = len(atom.arguments)
        inner = ",".join(map(self._term, atom.arguments))
        return f"{name}({inner})" if inner else name

    def _term(self, term: Term) -> str:
        if isinstance(term, Variable):
            return f"V{term.name}"
        assert isinstance(term, Function)
        return str(self.numbers[term.name])

    def _action(self, index: int, action: DurativeAction) -> Iterator[str]:
        """The rules of one action: s0 is its start, a0 all of it."""
        inner = ",".join(self._term(parameter.variable) for parameter in action.parameters)
        start, whole = (f"{name}{index}({inner})" if inner else f"{name}{index}" for name in "sa")
        types = [
            f"t_{parameter.type}({self._term(parameter.variable)})"
            for parameter in action.parameters
        ]
        yield _rule(start, [*types, *self._needs(action, index, early=True)])
        yield _rule(whole, [start, *self._needs(action, index, early=False)])
        for effect in action.effects:
            if (atom := _added_atom(effect)) is not None:
                guards = [f"t_{p.type}({self._term(p.variable)})" for p in effect.parameters]
                cause = start if effect.moment is Moment.START else whole
                yield _rule(self._atom(atom), [cause, *guards])

    def _needs(self, action: DurativeAction, index: int, early: bool) -> Iterator[str]:
        """The literals that the start of an instance needs, or those that the end needs beside
        them.
        """
        for timed in action.conditions:
            for part in _conjuncts(timed.condition):
                if isinstance(part, Literal) and part.positive:
                    late = timed.moment is Moment.END or (
                        timed.moment is Moment.THROUGHOUT
                        and part.atom.name in self.mutual.get(index, ())
                    )
                    if late != early:
                        yield self._atom(part.atom)
                elif early and isinstance(part, Comparison) and not part.exact:
                    yield f"{self._term(part.left)} {part.relation} {self._term(part.right)}"


def _rule(head: str, body: list[str]) -> str:
    return f"{head} :- {', '.join(dict.fromkeys(body))}." if body else f"{head}."


def mutual_predicates(actions: Sequence[DurativeAction]) -> dict[int, set[str]]:
    """For each action by its number: what it holds over all and what a start adds that may have
    to come together with its own start.

    Two actions may each hold what the start of the other adds. They begin at one instant.
    """
    graph: dict[int | str, list[int | str]] = {}
    for index, action in enumerate(actions):
        graph[index] = [
            part.atom.name
            for timed in action.conditions
            if timed.moment is Moment.THROUGHOUT
            for part in _conjuncts(timed.condition)
            if isinstance(part, Literal) and part.positive
        ]
        for effect in action.effects:
            if effect.moment is Moment.START and (atom := _added_atom(effect)) is not None:
                graph.setdefault(atom.name, []).append(index)
    for targets in list(graph.values()):
        for vertex in targets:
            graph.setdefault(vertex, [])
    result: dict[int, set[str]] = {}
    for component in strong_components(graph):
        names = {vertex for vertex in component if isinstance(vertex, str)}
        result |= {vertex: names for vertex in component if isinstance(vertex, int)}
    return result


def _added_atom(effect: TimedEffect) -> Atom | None:
    """The atom that an effect makes true."""
    change = effect.change
    return change.atom if isinstance(change, Literal) and change.positive else None


def _conjuncts(condition: Condition) -> tuple[Condition, ...]:
    return goal_parts(condition) if isinstance(condition, And) else (condition,)

"""The reachable action instances and atoms of a problem in time, if nothing ever became false;
computed by clingo.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from cellwright.kb.asp import Grounder
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
        inner = ",".join(self._term(parameter.variable) for parameter in action.parameters)
        head = f"a{index}({inner})" if inner else f"a{index}"
        body = [
            f"t_{parameter.type}({self._term(parameter.variable)})"
            for parameter in action.parameters
        ]
        body += dict.fromkeys(self._needs(action))
        yield f"{head} :- {', '.join(body)}." if body else f"{head}."
        for effect in action.effects:
            if isinstance(effect.change, Literal) and effect.change.positive:
                guards = [f"t_{p.type}({self._term(p.variable)})" for p in effect.parameters]
                yield f"{self._atom(effect.change.atom)} :- {', '.join([head, *guards])}."

    def _needs(self, action: DurativeAction) -> Iterator[str]:
        """The literals that an instance needs of others: not those that its own start may add."""
        own = {_predicate(effect) for effect in action.effects if effect.moment is Moment.START}
        for timed in action.conditions:
            for part in _conjuncts(timed.condition):
                if isinstance(part, Literal) and part.positive:
                    if timed.moment is Moment.START or part.atom.name not in own:
                        yield self._atom(part.atom)
                elif (
                    isinstance(part, Comparison) and not part.exact and part.relation in ("=", "!=")
                ):
                    yield f"{self._term(part.left)} {part.relation} {self._term(part.right)}"


def _predicate(effect: TimedEffect) -> str:
    return effect.change.atom.name if isinstance(effect.change, Literal) else ""


def _conjuncts(condition: Condition) -> tuple[Condition, ...]:
    return goal_parts(condition) if isinstance(condition, And) else (condition,)

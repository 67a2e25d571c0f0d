"""A ground task as PDDL: an action without parameters per operator; quantities as functions."""

from collections.abc import Iterator, Sequence

from cellwright.engine.formats.interop.pddl.export.pddl_names import PddlNames
from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.model.ground_axioms import (
    OPPOSITE_SIGNS,
    Comparing,
    Linear,
    QuantityAssignment,
    QuantityLevel,
)
from cellwright.engine.model.ground_task import ConditionalEffect, GroundOperator, GroundTask
from cellwright.kb.terms import Function


class NumericFluents:
    """The quantities of a task that are compared or changed, and how they are written."""

    def __init__(self, task: GroundTask, names: PddlNames) -> None:
        self._task, self._names = task, names
        self._tests = task.axioms.tests if task.axioms else ()
        self._compared: dict[int, tuple[Comparing, str]] = {}
        for test in self._tests:
            self._compared[test.atom] = (test, test.relation)
            if task.axioms and (complement := task.axioms.complements.get(test.atom)) is not None:
                self._compared[complement] = (test, OPPOSITE_SIGNS[test.relation])
        self.levels = tuple(dict.fromkeys(self._met()))

    def _met(self) -> Iterator[QuantityLevel]:
        for test in self._tests:
            yield from (level for level, _ in test.sum.parts)
        for operator in self._task.operators:
            for change in operator.changes:
                yield change.level
                yield from (level for level, _ in change.to.parts)

    @property
    def hidden(self) -> Bits:
        """The atoms that are no predicates of the export: comparisons, and values."""
        values = self.levels[0].met if self.levels else ()
        return bitset([*self._compared, *values])

    @property
    def functions(self) -> list[str]:
        """The functions, as they are declared."""
        return [self._function(level) for level in self.levels]

    @property
    def values(self) -> list[str]:
        """What the functions are at the start."""
        return [
            f"(= {self._function(level)} {level.of(self._task.initial)})" for level in self.levels
        ]

    def comparison(self, atom: int) -> str | None:
        """The condition for an atom that compares quantities; None for any other atom."""
        if atom not in self._compared:
            return None
        test, relation = self._compared[atom]
        left, right = self._written(Linear(test.sum.parts, 0)), -test.sum.constant
        return f"(not (= {left} {right}))" if relation == "!=" else f"({relation} {left} {right})"

    def effects(self, changes: Sequence[QuantityAssignment]) -> list[str]:
        """What a step does to quantities."""
        return [written for change in changes if (written := self._effect(change))]

    def _effect(self, change: QuantityAssignment) -> str:
        name, rest = self._function(change.level), change.to.without(change.level)
        if change.level in dict(rest.parts):
            return f"(assign {name} {self._written(change.to)})"
        if not rest.parts:
            verb = "increase" if rest.constant > 0 else "decrease"
            return f"({verb} {name} {abs(rest.constant)})" if rest.constant else ""
        return f"(increase {name} {self._written(rest)})"

    def _written(self, sum_: Linear) -> str:
        terms = [self._product(level, factor) for level, factor in sum_.parts]
        terms += [str(sum_.constant)] if sum_.constant or not terms else []
        total = terms[0]
        for summand in terms[1:]:
            total = f"(+ {total} {summand})"
        return total

    def _product(self, level: QuantityLevel, factor: int) -> str:
        return self._function(level) if factor == 1 else f"(* {factor} {self._function(level)})"

    def _function(self, level: QuantityLevel) -> str:
        return f"({self._names.of('function', str(level.quantity))})"


class GroundWriter:
    """Writes one ground task.

    Negative conditions become separate atoms, unless there are conditional effects or axioms.
    """

    def __init__(self, name: str, task: GroundTask) -> None:
        self.name, self.task, self.names = name, task, PddlNames()
        self.conditional = any(operator.conditional for operator in task.operators)
        self.rules = task.axioms is not None and bool(task.axioms.rules)
        self.plain = not self.conditional and not self.rules
        self.sums = NumericFluents(task, self.names)
        self.actions: dict[str, GroundOperator] = {}
        for operator in task.operators:
            self.actions[self._fresh(operator.instance)] = operator
        self.priced = any(operator.cost != 1 for operator in task.operators)

    def _fresh(self, instance: Function) -> str:
        """A new name for an operator, because several operators may belong to one instance."""
        number, said = 1, str(instance)
        while (action_name := self.names.of("action", said)) in self.actions:
            number += 1
            said = f"{instance} {number}"
        return action_name

    def domain(self) -> str:
        """The domain file."""
        requirements = [":strips"]
        requirements += [] if self.plain else [":negative-preconditions"]
        requirements += [":conditional-effects"] if self.conditional else []
        requirements += (
            [":disjunctive-preconditions"] if len(self.task.goals) > 1 or self.rules else []
        )
        requirements += [":derived-predicates"] if self.rules else []
        requirements += [":numeric-fluents"] if self.sums.levels else []
        functions = [*(["(total-cost)"] if self.priced else []), *self.sums.functions]
        requirements += [":action-costs"] if self.priced else []
        parts = [
            f"(define (domain {self.names.of('domain', self.name)})",
            f"  (:requirements {' '.join(requirements)})",
            "  (:predicates "
            f"{self._all((1 << len(self.task.atoms)) - 1)}{'' if self.task.goals else self._never})",
            *([f"  (:functions {' '.join(functions)} - number)"] if functions else []),
            *self._derived(),
            *(self._action(name, operator) for name, operator in self.actions.items()),
        ]
        return "\n".join(parts) + ")\n"

    def problem(self) -> str:
        """The problem file."""
        goals = [f"(and {self._conditions(goal)})" for goal in self.task.goals] or [
            f"(and{self._never})"
        ]
        derived = self.task.axioms.derived if self.task.axioms else 0
        facts = self._all(self.task.initial & ~derived) + (
            " (= (total-cost) 0)" if self.priced else ""
        )
        facts = " ".join([facts, *self.sums.values])
        parts = [
            f"(define (problem {self.names.of('problem', self.name)})",
            f"  (:domain {self.names.of('domain', self.name)})",
            f"  (:init {facts})",
            f"  (:goal {goals[0] if len(goals) == 1 else '(or ' + ' '.join(goals) + ')'})",
            *(["  (:metric minimize (total-cost))"] if self.priced else []),
        ]
        return "\n".join(parts) + ")\n"

    def _derived(self) -> Iterator[str]:
        """The rules of derived atoms."""
        for atom, rules in self.task.axioms.by_head.items() if self.task.axioms else ():
            bodies = [f"(and {self._conditions(rule.body)})" for rule in rules]
            if bodies:
                yield f"  (:derived {self._atom(atom)} (or {' '.join(bodies)}))"

    @property
    def _never(self) -> str:
        """An atom that nothing makes true; it is the goal if no goal can be reached."""
        return f" ({self.names.of('predicate', '_never')})"

    def _complement(self, index: int) -> bool:
        return self.task.atoms[index].name == "not"

    def _atom(self, index: int) -> str:
        return f"({self.names.of('predicate', str(self.task.atoms[index]))})"

    def _all(self, atoms: Bits) -> str:
        shown = indices(atoms & ~self.sums.hidden)
        return " ".join(self._atom(i) for i in shown if self.plain or not self._complement(i))

    def _conditions(self, atoms: Bits) -> str:
        """A conjunction. A complementary atom that is not kept is written as a negation."""
        return " ".join(self._condition(index) for index in indices(atoms))

    def _condition(self, index: int) -> str:
        if (compared := self.sums.comparison(index)) is not None:
            return compared
        atom = self.task.atoms[index]
        if self.plain or not self._complement(index):
            return self._atom(index)
        return f"(not ({self.names.of('predicate', str(atom.arguments[0]))}))"

    def _action(self, name: str, operator: GroundOperator) -> str:
        effects = self._effects(operator.adds, operator.deletes & ~operator.adds)
        effects += [f"(increase (total-cost) {operator.cost})"] if self.priced else []
        effects += self.sums.effects(operator.changes)
        effects += [self._conditional(effect) for effect in operator.conditional]
        return (
            f"  (:action {name}\n   :parameters ()\n   :precondition (and"
            f" {self._conditions(operator.preconditions)})\n   :effect (and {' '.join(effects)}))"
        )

    def _effects(self, adds: Bits, deletes: Bits) -> list[str]:
        kept = [index for index in indices(deletes) if self.plain or not self._complement(index)]
        added = [self._all(adds)] if adds else []
        return [*added, *(f"(not {self._atom(index)})" for index in kept)]

    def _conditional(self, effect: ConditionalEffect) -> str:
        changes = " ".join(self._effects(effect.adds, effect.deletes & ~effect.adds))
        return f"(when (and {self._conditions(effect.condition)}) (and {changes}))"

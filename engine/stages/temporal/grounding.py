"""Grounds a problem in time to action instances over numbered facts; conditions become
alternatives.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

from cellwright.engine.model.temporal import (
    CONSTANT,
    LENGTH,
    VALUE,
    GroundTimes,
    Happening,
    NumericTest,
    NumericUpdate,
    Program,
    Span,
    TimedHappening,
)
from cellwright.engine.stages.temporal.formulas import (
    TRUE_CONJUNCTION,
    Alternatives,
    Bindings,
    Conjunction,
    Surroundings,
    constant,
    contradictory,
    negation,
    together,
)
from cellwright.engine.stages.temporal.plain import Facts, PlainAction, is_plain
from cellwright.engine.stages.temporal.reachable import Reached, reach
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.durative import (
    DurativeAction,
    Moment,
    NumericChange,
    TemporalProblem,
    TimedChange,
    TimedEffect,
    decimals,
)
from cellwright.kb.terms import Atom, Function, substitute_atom

MAX_VARIANTS = (
    # of one instance: alternatives of its conditions, and which of its conditional effects happen
    256
)
START, THROUGHOUT, END = Moment.START, Moment.THROUGHOUT, Moment.END
ZERO: Program = ((CONSTANT, Fraction(0)),)


def ground_times(problem: TemporalProblem) -> GroundTimes:
    """The ground problem. Raises `InvalidInput` for what is not supported with times."""
    return _Grounding(problem, reach(problem)).result()


Readings = dict[Moment, tuple[tuple[Atom, ...], tuple[int, ...]]]


@dataclass
class _Draft:
    """An instance before its facts are numbered."""

    name: Function
    conditions: dict[Moment, Conjunction]
    changes: dict[Moment, dict[Atom, bool]]
    updates: dict[Moment, list[NumericUpdate]] = field(default_factory=dict)
    read: Readings = field(default_factory=dict)
    shortest: Program = ZERO
    longest: Program | None = None
    instantaneous: bool = False


class _Grounding:
    def __init__(self, problem: TemporalProblem, reached: Reached) -> None:
        self.problem, self.reached = problem, reached
        self.added, self.deleted = self._changed(True), self._changed(False)
        self.members: dict[str, list[str]] = {}
        changing = self._changing()
        values = {
            each: value for each, value in problem.values.items() if each.name not in changing
        }
        self.numbers: dict[Function, int] = {}
        # the numbers that have no value at the start, and those without one after timed changes
        self.unset: set[int] = set()
        self.unset_later: set[int] = set()
        for fluent in problem.values:
            if fluent.name in changing:
                self.numbers[fluent] = len(self.numbers)
        self.around = Surroundings(
            self._possible,
            self._avoidable,
            self._untouched,
            values,
            self.numbers,
            self._members,
            self.unset,
        )

    def _changed(self, positive: bool) -> set[str]:
        """The predicates that something can make true, or false."""
        effects = [effect.change for action in self.problem.actions for effect in action.effects]
        changes = [*effects, *(each.change for each in self.problem.changes)]
        return {e.atom.name for e in changes if isinstance(e, Literal) and e.positive == positive}

    def _changing(self) -> set[str]:
        """The functions that something changes."""
        effects = [effect.change for action in self.problem.actions for effect in action.effects]
        changes = [*effects, *(each.change for each in self.problem.changes)]
        return {each.fluent.name for each in changes if isinstance(each, NumericChange)}

    def _possible(self, atom: Atom) -> bool:
        return atom in self.reached.atoms

    def _avoidable(self, atom: Atom) -> bool:
        changing = atom.name in self.deleted or atom.name in self.added
        return changing or atom not in self.problem.initial

    def _untouched(self, atom: Atom) -> bool:
        return atom.name not in self.deleted

    def _members(self, type_: str) -> list[str]:
        if type_ not in self.members:
            self.members[type_] = self.problem.members(type_)
        return self.members[type_]

    def result(self) -> GroundTimes:
        """The ground problem: instances first, because they say which negations are facts."""
        self._assigned()
        drafts: list[_Draft] = []
        plain: list[_Instance] = []
        facts: Facts = {}
        names = [Function(name) for name in self.reached.objects]
        for action, rows in zip(self.problem.actions, self.reached.instances, strict=True):
            if is_plain(action, self.around):
                plain += _instances(PlainAction(action, self.around, names, facts), rows)
                continue
            schema = _Schema(action, self.around)
            for row in rows:
                drafts += schema.drafts(tuple(names[number] for number in row))
        goals = [c for c in self.around.alternatives(self.problem.goal, {}) if not contradictory(c)]
        return self._numbered(drafts, plain, facts, goals)

    def _assigned(self) -> None:
        """Numbers that have no value at the start, but that some effect assigns, are numbers,
        too. What nothing assigns never has a value.
        """
        known = len(self.numbers)
        names = [Function(name) for name in self.reached.objects]
        for action, rows in zip(self.problem.actions, self.reached.instances, strict=True):
            variables = [parameter.variable for parameter in action.parameters]
            for effect in action.effects:
                change = effect.change
                if not isinstance(change, NumericChange) or change.kind != "assign":
                    continue
                for row in rows:
                    outer = dict(zip(variables, (names[number] for number in row), strict=True))
                    for own in self.around.bindings(effect.parameters, outer):
                        self.numbers.setdefault(
                            substitute_atom(change.fluent, own), len(self.numbers)
                        )
        for timed in self.problem.changes:
            if isinstance(timed.change, NumericChange) and timed.change.kind == "assign":
                self.numbers.setdefault(timed.change.fluent, len(self.numbers))
        self.unset.update(range(known, len(self.numbers)))

    def _numbered(
        self, drafts: list[_Draft], plain: list["_Instance"], facts: Facts, goals: list[Conjunction]
    ) -> GroundTimes:
        conditions = [c for draft in drafts for c in draft.conditions.values()]
        for part in (*conditions, *goals):
            for literal in (
                sorted(part.literals, key=_literal_key) if len(part.literals) > 1 else part.literals
            ):
                facts.setdefault(literal, len(facts))
        for atom in (*self._read_only(drafts), *self._contended(drafts, plain)):
            if (atom, False) not in facts:
                facts.setdefault((atom, True), len(facts))
        numbering = _Numbering(facts)
        initial = {
            number
            for (atom, positive), number in facts.items()
            if (atom in self.problem.initial) == positive
        }
        general = dict.fromkeys(map(numbering.span, drafts))
        spans = (*general, *(own.span(row, needs, limits) for own, row, needs, limits in plain))
        values = tuple(self.problem.values.get(fluent) for fluent in self.numbers)
        timed = tuple(numbering.timed(at, changes) for at, changes in self._timed())
        wanted = tuple((numbering.literals(part), part.tests) for part in goals)
        return GroundTimes(
            tuple(facts),
            tuple(self.numbers),
            spans,
            frozenset(initial),
            values,
            timed,
            wanted,
            self.problem.epsilon,
        )

    def _read_only(self, drafts: list[_Draft]) -> list[Atom]:
        """Atoms that conditions read as alternatives, and that something changes."""
        read = dict.fromkeys(
            atom for draft in drafts for atoms, _ in draft.read.values() for atom in atoms
        )
        return [atom for atom in read if atom.name in self.added | self.deleted]

    def _contended(self, drafts: list[_Draft], plain: list["_Instance"]) -> list[Atom]:
        """Atoms that some instants make true and others false: these are apart, also where no
        condition reads the atoms.
        """
        names = self.added & self.deleted
        rows: dict[PlainAction, list[tuple[int, ...]]] = {}
        for action, row, _, _ in plain:
            rows.setdefault(action, []).append(row)
        changes = [
            pair for action, own in rows.items() for pair in action.changed_atoms(own, names)
        ]
        changes += [
            pair for draft in drafts for atoms in draft.changes.values() for pair in atoms.items()
        ]
        timed = (event.change for event in self.problem.changes)
        changes += [(fact.atom, fact.positive) for fact in timed if isinstance(fact, Literal)]
        added = dict.fromkeys(atom for atom, positive in changes if positive)
        deleted = {atom for atom, positive in changes if not positive}
        return [atom for atom in added if atom in deleted]

    def _timed(self) -> Iterator[tuple[Fraction, tuple[dict[Atom, bool], list[NumericUpdate]]]]:
        self.unset_later = set(self.unset)
        for at, group in itertools.groupby(self.problem.changes, key=lambda each: each.at):
            atoms: dict[Atom, bool] = {}
            updates: list[NumericUpdate] = []
            for each in group:
                if isinstance(each.change, Literal):
                    atoms[each.change.atom] = (
                        atoms.get(each.change.atom, False) or each.change.positive
                    )
                else:
                    updates.append(self._timed_update(each, each.change))
            self.unset_later -= {update.number for update in updates}
            yield at, (atoms, updates)

    def _timed_update(self, timed: TimedChange, change: NumericChange) -> NumericUpdate:
        """The change of a number by itself. Raises `InvalidInput` if it may have no value."""
        program = self.around.program(change.amount, {})
        number = self.numbers.get(change.fluent)
        if program is not None and number is not None:
            update = NumericUpdate(change.kind, number, program)
            around = replace(self.around, unset=self.unset_later)
            if not any(around.value_tests(update)):
                return update
        said = f"what {change.fluent} becomes at {decimals(timed.at)} may have no value"
        hint = "give what it reads a value in :init"
        raise InvalidInput([Diagnostic(timed.where, "K802", said, hint)])


_Instance = tuple[
    PlainAction, tuple[int, ...], list[tuple[int, ...]], tuple[Program, Program | None]
]


def _instances(action: PlainAction, rows: Sequence[tuple[int, ...]]) -> Iterator[_Instance]:
    """The instances of an action with literals alone: what each needs, and how long it takes."""
    for row in rows:
        needs = action.needs(row)
        limits = action.limits(row) if needs is not None else None
        if needs is not None and limits is not None:
            yield action, row, needs, limits


def _literal_key(literal: tuple[Atom, bool]) -> tuple[str, bool]:
    return str(literal[0]), literal[1]


@dataclass(frozen=True)
class _Numbering:
    facts: Mapping[tuple[Atom, bool], int]

    def literals(self, part: Conjunction) -> tuple[int, ...]:
        """The numbers of the literals of a conjunction."""
        return tuple(sorted(self.facts[literal] for literal in part.literals))

    def _effects(self, changes: Mapping[Atom, bool]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """What becomes true and what becomes false, with the negations that are facts."""
        adds, deletes = [], []
        for atom, positive in changes.items():
            if (same := self.facts.get((atom, positive))) is not None:
                adds.append(same)
            if (opposite := self.facts.get((atom, not positive))) is not None:
                deletes.append(opposite)
        return tuple(sorted(adds)), tuple(sorted(deletes))

    def _happening(self, draft: _Draft, moment: Moment) -> Happening:
        part = draft.conditions.get(moment, TRUE_CONJUNCTION)
        adds, deletes = self._effects(draft.changes.get(moment, {}))
        updates = tuple(draft.updates.get(moment, ()))
        needs = self.literals(part)
        atoms, numbers = draft.read.get(moment, ((), ()))
        both = ((atom, positive) for atom in atoms for positive in (True, False))
        read = {self.facts[literal] for literal in both if literal in self.facts}
        facts_read = tuple(sorted(read.difference(needs)))
        return Happening(needs, adds, deletes, part.tests, updates, facts_read, numbers)

    def span(self, draft: _Draft) -> Span:
        """An instance over numbered facts."""
        during = draft.conditions.get(THROUGHOUT, TRUE_CONJUNCTION)
        return Span(
            draft.name,
            self._happening(draft, START),
            self._happening(draft, END),
            self.literals(during),
            during.tests,
            draft.shortest,
            draft.longest,
            draft.instantaneous,
        )

    def timed(
        self, at: Fraction, changes: tuple[dict[Atom, bool], list[NumericUpdate]]
    ) -> TimedHappening:
        """What happens by itself at a time."""
        adds, deletes = self._effects(changes[0])
        return TimedHappening(at, Happening((), adds, deletes, (), tuple(changes[1])))


class _Schema:
    """Makes instances of one action."""

    def __init__(self, action: DurativeAction, around: Surroundings) -> None:
        self.action, self.around = action, around
        self.variables = [parameter.variable for parameter in action.parameters]
        self.plain = [effect for effect in action.effects if not effect.when]
        self.conditional = [effect for effect in action.effects if effect.when]

    def drafts(self, arguments: Sequence[Function]) -> Iterator[_Draft]:
        """All variants of one instance: one for each choice of alternatives."""
        own: Bindings = dict(zip(self.variables, arguments, strict=True))
        conditions = self._conditions(own)
        limits = self._limits(own) if conditions is not None else None
        if conditions is None or limits is None:
            return
        shortest, longest = limits
        name = Function(self.action.name, tuple(arguments))
        read = {moment: self._read(moment, own) for moment in (START, END)}
        base = _Draft(name, {}, {}, {}, read, shortest, longest, self.action.instantaneous)
        effects = self._conditional(own)
        count = 0
        for happening in itertools.product((True, False), repeat=len(effects)):
            for draft in self._variants(base, conditions, own, effects, happening):
                count += 1
                if count > MAX_VARIANTS:
                    raise self._refusal(
                        f"an instance with more than {MAX_VARIANTS} variants is not supported"
                    )
                yield draft

    def _refusal(self, said: str) -> InvalidInput:
        hint = "split the action into several"
        return InvalidInput([Diagnostic(self.action.where, "K802", f"{said} with times", hint)])

    def _conditions(self, own: Bindings) -> dict[Moment, Alternatives] | None:
        """The conditions of each moment as alternatives; None if one is never true."""
        result: dict[Moment, Alternatives] = {}
        for moment in Moment:
            parts = tuple(
                each.condition for each in self.action.conditions if each.moment is moment
            )
            if parts:
                result[moment] = self.around.alternatives(
                    parts[0] if len(parts) == 1 else And(parts), own
                )
                if not result[moment]:
                    return None
        return result

    def _read(self, moment: Moment, own: Bindings) -> tuple[tuple[Atom, ...], tuple[int, ...]]:
        """The atoms and numbers that the conditions of one instant read without needing them.

        Whether a conditional effect happens is a choice, too.
        """
        parts = [
            self.around.choices_read(each.condition, own)
            for each in self.action.conditions
            if each.moment is moment
        ]
        parts += [
            self.around.choices_read(each.condition, inner, True)
            for effect in self.conditional
            for each in effect.when
            if each.moment is moment
            for inner in self.around.bindings(effect.parameters, own)
        ]
        read = list(dict.fromkeys(itertools.chain.from_iterable(parts)))
        programs = (each for each in read if not isinstance(each, Function))
        numbers = {int(value) for program in programs for sign, value in program if sign == VALUE}
        atoms = tuple(each for each in read if isinstance(each, Function))
        return atoms, tuple(sorted(numbers))

    def _limits(self, own: Bindings) -> tuple[Program, Program | None] | None:
        """The shortest and the longest duration; None if they contradict each other or have no
        value.
        """
        if self.action.instantaneous:
            return ZERO, ZERO
        lower: list[Program] = []
        upper: list[Program] = []
        for limit in self.action.limits:
            program = self.around.program(limit.amount, own)
            if program is None:
                return None
            if limit.moment is END and constant(program) is None:
                raise self._refusal(
                    "a duration that depends on numbers at the end is not supported"
                )
            lower += [program] if limit.relation in ("=", ">=") else []
            upper += [program] if limit.relation in ("=", "<=") else []
        shortest, longest = self._tightest(lower, max, ZERO), self._tightest(upper, min, None)
        assert shortest is not None
        least, most = constant(shortest), constant(longest) if longest is not None else None
        if (most is not None and most < (least or 0)) or (longest is shortest and (least or 0) < 0):
            return None
        return shortest, longest

    def _tightest(
        self, limits: list[Program], choose: object, default: Program | None
    ) -> Program | None:
        distinct = list(dict.fromkeys(limits))
        if not distinct:
            return default
        values = [constant(each) for each in distinct]
        if len(distinct) > 1 and None in values:
            raise self._refusal(
                "a duration with several limits that depend on numbers is not supported"
            )
        if len(distinct) == 1:
            return distinct[0]
        return ((CONSTANT, choose(values)),)  # type: ignore[operator]

    def _conditional(self, own: Bindings) -> list[tuple[TimedEffect, Bindings]]:
        """The conditional effects whose conditions are neither always nor never true, each with
        its bindings.
        """
        result = []
        for effect in self.conditional:
            for inner in self.around.bindings(effect.parameters, own):
                parts = [self.around.alternatives(each.condition, inner) for each in effect.when]
                if all(parts):
                    result.append((effect, inner))
        if len(result) > MAX_VARIANTS.bit_length():
            raise self._refusal("an instance with that many conditional effects is not supported")
        return result

    def _variants(
        self,
        base: _Draft,
        conditions: dict[Moment, Alternatives],
        own: Bindings,
        effects: list[tuple[TimedEffect, Bindings]],
        happening: tuple[bool, ...],
    ) -> Iterator[_Draft]:
        """The variants in which some conditional effects happen and the others do not."""
        wanted = dict(conditions)
        choices: list[list[dict[Moment, Alternatives]]] = []
        for (effect, inner), happens in zip(effects, happening, strict=True):
            parts = [(each.moment, each.condition) for each in effect.when]
            if happens:
                choices.append(
                    [self._at_moments([(m, self.around.alternatives(c, inner)) for m, c in parts])]
                )
            else:
                choices.append(
                    [{m: self.around.alternatives(negation(c), inner)} for m, c in parts]
                )
        for combination in itertools.product(*choices):
            merged = dict(wanted)
            for extra in combination:
                for moment, alternatives in extra.items():
                    merged[moment] = tuple(
                        together(one, two)
                        for one in merged.get(moment, (TRUE_CONJUNCTION,))
                        for two in alternatives
                    )
            happened = [pair for pair, happens in zip(effects, happening, strict=True) if happens]
            yield from self._drafts_of(base, merged, own, happened)

    def _at_moments(self, parts: list[tuple[Moment, Alternatives]]) -> dict[Moment, Alternatives]:
        result: dict[Moment, Alternatives] = {}
        for moment, alternatives in parts:
            before = result.get(moment, (TRUE_CONJUNCTION,))
            result[moment] = tuple(together(one, two) for one in before for two in alternatives)
        return result

    def _drafts_of(
        self,
        base: _Draft,
        conditions: dict[Moment, Alternatives],
        own: Bindings,
        happened: list[tuple[TimedEffect, Bindings]],
    ) -> Iterator[_Draft]:
        effects = self._effects(own, happened)
        if effects is None:
            return
        changes, updates = effects
        conditions = dict(conditions)
        for moment, listed in updates.items():
            before = conditions.get(moment, (TRUE_CONJUNCTION,))
            conditions[moment] = self.around.with_values(before, listed)
        moments = list(conditions)
        for chosen in itertools.product(*conditions.values()):
            if any(map(contradictory, chosen)):
                continue
            draft = replace(
                base,
                conditions=dict(zip(moments, chosen, strict=True)),
                changes=changes,
                updates=updates,
            )
            yield self._with_length(draft)

    def _effects(
        self, own: Bindings, happened: list[tuple[TimedEffect, Bindings]]
    ) -> tuple[dict[Moment, dict[Atom, bool]], dict[Moment, list[NumericUpdate]]] | None:
        """What happens at each moment; None if it reads a number that never has a value.

        An atom that is both deleted and added at one instant is true afterwards.
        """
        changes: dict[Moment, dict[Atom, bool]] = {START: {}, END: {}}
        updates: dict[Moment, list[NumericUpdate]] = {START: [], END: []}
        plain = [
            (effect, inner)
            for effect in self.plain
            for inner in (
                self.around.bindings(effect.parameters, own) if effect.parameters else (own,)
            )
        ]
        for effect, inner in (*plain, *happened):
            change = effect.change
            if isinstance(change, Literal):
                atom = substitute_atom(change.atom, inner)
                before = changes[effect.moment].get(atom, False)
                changes[effect.moment][atom] = before or change.positive
                continue
            program = self.around.program(change.amount, inner)
            number = self.around.numbers.get(substitute_atom(change.fluent, inner))
            if program is None or number is None:
                return None
            updates[effect.moment].append(NumericUpdate(change.kind, number, program))
        return changes, updates

    def _with_length(self, draft: _Draft) -> _Draft:
        """The instance with its duration in place of `?duration`, where that is fixed."""
        if not self._reads_length(draft):
            return draft
        if draft.longest != draft.shortest:
            raise self._refusal(
                "?duration in a condition or an effect, where it may vary, is not supported"
            )
        length = draft.shortest

        def filled(program: Program) -> Program:
            return tuple(
                step for each in program for step in (length if each[0] == LENGTH else (each,))
            )

        conditions = {
            moment: Conjunction(
                part.literals,
                tuple(NumericTest(test.relation, filled(test.program)) for test in part.tests),
            )
            for moment, part in draft.conditions.items()
        }
        updates = {
            moment: [replace(update, program=filled(update.program)) for update in listed]
            for moment, listed in draft.updates.items()
        }
        if constant(length) is None and (
            updates[END] or conditions.get(END, TRUE_CONJUNCTION).tests
        ):
            raise self._refusal(
                "?duration at the end, where it depends on numbers, is not supported"
            )
        return replace(draft, conditions=conditions, updates=updates)

    def _reads_length(self, draft: _Draft) -> bool:
        tests = [test.program for part in draft.conditions.values() for test in part.tests]
        updates = [update.program for listed in draft.updates.values() for update in listed]
        return any(step[0] == LENGTH for program in (*tests, *updates) for step in program)

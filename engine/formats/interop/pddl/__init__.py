"""PDDL in: a domain file and a problem file become a problem of the same model as our own language.

The reader accepts STRIPS, typing with `either`, negative, disjunctive and quantified conditions,
equality, conditional effects, derived predicates, action costs, constants and numbers (McDermott et
al. 1998; Edelkamp & Hoffmann 2004 for the axioms; Fox & Long 2003 for numbers). It refuses
preferences, constraints and numbers that are not linear; the message names each with its place.
Tasks with times have a reader of their own (`durative`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from cellwright.engine.formats.interop.pddl.declared_names import NameMapping, read_typed_list
from cellwright.engine.formats.interop.pddl.domain_reader import DomainReader
from cellwright.engine.formats.interop.pddl.expressions import (
    Document,
    Expression,
    Group,
    PddlWord,
    read_document,
)
from cellwright.engine.formats.interop.pddl.keywords import check_sections
from cellwright.engine.formats.interop.pddl.numeric_functions import (
    MAX_PDDL_NUMBER,
    FunctionReader,
    TaskFunctions,
    Unreadable,
    function_of,
    words_in,
    written_number,
)
from cellwright.engine.formats.interop.pddl.pddl_conditions import ConditionReader
from cellwright.engine.formats.interop.pddl.start_values import StartValues
from cellwright.engine.formats.interop.pddl.task_files import DOMAIN, PROBLEM
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, nearest_hint
from cellwright.kb.model.conditions import ALWAYS_TRUE, Condition
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function


@dataclass(frozen=True, slots=True)
class PddlProblem:
    """A problem, and the PDDL name for each of its names.

    A cost of 1 counts as `unit_of_cost`; `warnings` say what is not followed.
    """

    problem: Problem
    names: NameMapping
    unit_of_cost: int = 1
    warnings: tuple[Diagnostic, ...] = ()


def read_pddl_task(domain_path: Path, problem_path: Path) -> PddlProblem:
    """The problem in two files. Raises `InvalidInput` with all errors in them."""
    reader = DomainReader(read_document(domain_path, DOMAIN))
    reader.declare()
    problem_document = read_document(problem_path, PROBLEM)
    task = _ProblemReader(problem_document, reader)
    problem = task.read()
    if reader.document.found or problem_document.found:
        raise InvalidInput([*reader.document.found, *problem_document.found])
    return PddlProblem(
        problem, reader.scope.names, task.functions.unit_of_cost, tuple(task.warnings())
    )


class _ProblemReader:
    def __init__(self, document: Document, domain: DomainReader) -> None:
        self.document, self.domain, self.scope = document, domain, domain.scope
        self.functions, self.conditions = TaskFunctions(), ConditionReader(document, self.scope)
        self.objects: dict[str, str] = {}
        self.values: dict[Function, Fraction] = {}
        self.passed_over: list[Diagnostic] = []
        self.sections = {part.head: part for part in document.root.rest if isinstance(part, Group)}

    def read(self) -> Problem:
        """Read the objects before the actions, which may only name constants; then the facts
        and the goal.
        """
        check_sections(self.document, "problem")
        if ":objects" in self.sections:
            self.domain.declare_objects(self.document, self.sections[":objects"].rest, self.objects)
        facts = self.sections[":init"].rest if ":init" in self.sections else ()
        values = StartValues(facts, self.scope)
        declared = set(self.scope.functions)
        self.functions = FunctionReader(
            self.domain.document, self.document, declared, values.count
        ).read()
        self.conditions.numbers.functions = self.functions
        self.functions.partial = values.partial(self.functions.declared)
        everything, self.scope.objects = self.scope.objects, dict(self.domain.constants)
        domain = self.domain.domain(self.functions)
        self.scope.objects = everything
        statics: list[Atom] = []
        initial: list[Atom] = []
        for part in facts:
            for fact, static in self._fact(part):
                (statics if static else initial).append(fact)
        initial += self._without_value(values)
        names = self.scope.names
        return Problem(
            self._name(),
            domain,
            {names.of("object", name): type_ for name, type_ in self.objects.items()},
            tuple(dict.fromkeys(statics)),
            tuple(dict.fromkeys(initial)),
            self._goal(),
            complete=True,
            path=self.document.file.path,
            where=self.document.where(self.document.root),
        )

    def _name(self) -> str:
        group = self.sections.get("problem")
        word = group.rest[0] if group and group.rest else None
        return word.text if isinstance(word, PddlWord) else "problem"

    def _goal(self) -> Condition:
        group = self.sections.get(":goal")
        if group is None or len(group.rest) != 1:
            self.document.add(
                group or self.document.root,
                "K801",
                "a problem has one goal",
                "write (:goal (and ...))",
            )
            return ALWAYS_TRUE
        return self.conditions.condition(group.rest[0], {})

    def _fact(self, part: Expression) -> Iterator[tuple[Atom, bool]]:
        """A true fact, and whether it is static.

        Negated facts are skipped: in a closed world they say nothing new.
        """
        if isinstance(part, PddlWord):
            self.document.add(
                part, "K801", f"'{part.text}' is not a fact", "write facts in parentheses"
            )
        elif part.head == "=":
            yield from self._value(part)
        elif (part.head != "not" or len(part.rest) != 1) and (
            atom := self.conditions.atom(part, {})
        ):
            yield atom, part.head in self.domain.static
            if part.head in self.domain.derived:
                message = f"'{part.head}' is derived: no fact can say that it is true"
                self.document.add(
                    part, "K103", message, "leave it out, or declare another predicate"
                )

    def _value(self, part: Group) -> Iterator[tuple[Atom, bool]]:
        """The value of a function at the start."""
        function, value = (
            (function_of(part.rest[0]), written_number(part.rest[1]))
            if len(part.rest) == 2
            else (None, None)
        )
        if (
            function is not None
            and value is not None
            and function.head not in self.functions.declared
        ):
            self._undeclared(function)
        elif function is None or value is None:
            hint = "a number is whole or decimal, with at most 12 decimals: (= (fuel truck) 20.5)"
            if len(part.rest) == 2 and isinstance(part.rest[1], PddlWord) and value is None:
                hint = f"object fluents are not read; {hint}"
            self.document.add(part, "K802", "this initial value is not supported", hint)
        elif function.head not in self.functions.ignored:
            yield from self._known_value(part, function, value)

    def _undeclared(self, function: Group) -> None:
        where, near = (
            self.document.where(function),
            nearest_hint(function.head, list(self.functions.declared)),
        )
        message = f"function '{function.head}' is not declared, so its value says nothing"
        self.passed_over.append(Diagnostic(where, "K101", message, near, True))

    def _known_value(
        self, part: Group, function: Group, value: Fraction
    ) -> Iterator[tuple[Atom, bool]]:
        numbers = self.conditions.numbers
        try:
            read = self.conditions.function(function, {})
        except Unreadable as wrong:
            self.document.add(part, "K101", wrong.why)
            return
        if abs(value * self.functions.unit(function.head)) > MAX_PDDL_NUMBER:
            self.document.add(
                part,
                "K802",
                f"{value} is too large",
                f"as a whole number it exceeds {MAX_PDDL_NUMBER}",
            )
        if self.values.setdefault(read, value) != value:
            message = f"{' '.join(words_in(function))} has two values"
            self.document.add(part, "K115", message, "leave one of the facts out")
        changes = function.head in self.functions.changing
        if not changes:
            numbers.known[read] = value
        yield numbers.value(read, value), not changes
        if changes and function.head in self.functions.partial:
            yield numbers.has_value(read), False

    def _without_value(self, values: "StartValues") -> Iterator[Atom]:
        """A number for each function that changes and has no value yet.

        Nothing reads it before it is assigned.
        """
        for name in sorted(self.functions.changing & self.functions.partial):
            for arguments in values.instances(name, name in self.functions.wide):
                objects = (Function(self.scope.names.of("object", each)) for each in arguments)
                read = Function(self.scope.names.of("function", name), tuple(objects))
                if read not in self.values:
                    yield self.conditions.numbers.value(read, Fraction(0))

    def warnings(self) -> Iterator[Diagnostic]:
        """What plans do not follow, and what was passed over."""
        yield from self.passed_over
        if self.functions.unfollowed:
            where = self.document.where(self.sections[":metric"])
            message = f"the metric is not followed: {self.functions.unfollowed}"
            yield Diagnostic(where, "K802", message, "every step costs 1", True)


__all__ = ["PddlProblem", "read_pddl_task", "read_typed_list"]

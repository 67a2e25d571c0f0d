"""PDDL in: a domain file and a problem file become a problem of the same model as our own language.

The reader accepts STRIPS, typing with `either`, negative, disjunctive and quantified conditions,
equality, conditional effects, derived predicates, action costs, constants and numbers (McDermott et
al. 1998; Edelkamp & Hoffmann 2004 for the axioms; Fox & Long 2003 for numbers). It refuses times,
preferences, constraints and numbers that are not linear; the message names each with its place.
"""

from collections.abc import Iterator
from dataclasses import dataclass
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
from cellwright.engine.formats.interop.pddl.numeric_functions import (
    MAX_PDDL_NUMBER,
    FunctionReader,
    TaskFunctions,
    Unreadable,
    function_of,
    written_number,
)
from cellwright.engine.formats.interop.pddl.pddl_conditions import ConditionReader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.model.conditions import ALWAYS_TRUE, Condition
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom


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
    reader = DomainReader(read_document(domain_path))
    reader.declare()
    problem_document = read_document(problem_path)
    functions = FunctionReader(
        reader.document, problem_document, set(reader.scope.functions)
    ).read()
    task = _ProblemReader(problem_document, reader, functions)
    problem = task.read()
    if reader.document.found or problem_document.found:
        raise InvalidInput([*reader.document.found, *problem_document.found])
    return PddlProblem(problem, reader.scope.names, functions.unit_of_cost, tuple(task.warnings()))


class _ProblemReader:
    def __init__(self, document: Document, domain: DomainReader, functions: TaskFunctions) -> None:
        self.document, self.domain, self.scope = document, domain, domain.scope
        self.functions, self.conditions = (
            functions,
            ConditionReader(document, self.scope, functions),
        )
        self.objects: dict[str, str] = {}
        self.sections = {part.head: part for part in document.root.rest if isinstance(part, Group)}

    def read(self) -> Problem:
        """Read the objects first, because actions of the domain may only name constants; then
        the facts and the goal.
        """
        domain = self.domain.domain(self.functions)
        for section, group in self.sections.items():
            if section not in (
                ":domain",
                ":objects",
                ":init",
                ":goal",
                ":metric",
                ":requirements",
                "problem",
            ):
                self.document.add(
                    group, "K802", f"{section} is not supported", "only classical planning is read"
                )
        if ":objects" in self.sections:
            self.domain.declare_objects(self.document, self.sections[":objects"].rest, self.objects)
        statics: list[Atom] = []
        initial: list[Atom] = []
        for part in self.sections[":init"].rest if ":init" in self.sections else ():
            for fact, static in self._fact(part):
                (statics if static else initial).append(fact)
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
        if not isinstance(part, Group) or (part.head == "not" and len(part.rest) == 1):
            return
        if part.head == "=":
            yield from self._value(part)
            return
        atom = self.conditions.atom(part, {})
        if atom is not None:
            yield atom, part.head in self.domain.static

    def _value(self, part: Group) -> Iterator[tuple[Atom, bool]]:
        """The value of a function at the start."""
        function, value = (
            (function_of(part.rest[0]), written_number(part.rest[1]))
            if len(part.rest) == 2
            else (None, None)
        )
        if function is None or value is None or function.head not in self.functions.declared:
            hint = "a number is whole or decimal, with at most 12 decimals: (= (fuel truck) 20.5)"
            self.document.add(part, "K802", "this initial value is not supported", hint)
        elif function.head not in self.functions.ignored:
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
            static = function.head not in self.functions.changing
            if static:
                numbers.known[read] = value
            yield numbers.value(read, value), static

    def warnings(self) -> Iterator[Diagnostic]:
        """What plans do not follow."""
        if self.functions.unfollowed:
            where = self.document.where(self.sections[":metric"])
            message = f"the metric is not followed: {self.functions.unfollowed}"
            yield Diagnostic(where, "K802", message, "every step costs 1", True)


__all__ = ["PddlProblem", "read_pddl_task", "read_typed_list"]

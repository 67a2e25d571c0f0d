"""Which replies are normal, and what facts they give (ITA's reply and result patterns); of the others, which exceptions they are."""

from collections.abc import Mapping

from cellwright.engine.pipelines.execution.compiling import Compiled
from cellwright.engine.pipelines.execution.records import read_atom
from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.model.faults import FaultModel
from cellwright.kb.terms import Function, Term, Variable, is_ground, match, substitute


class Replies:
    """The reply patterns of a program."""

    def __init__(self, compiled: Compiled) -> None:
        self.compiled = compiled
        self._texts: dict[Term, str] = {}  # of the patterns without variables

    def step(self, activity: int) -> Function:
        """The step of an activity."""
        return read_atom(self.compiled.program.activities[activity].action)

    def is_normal(self, activity: int, text: str) -> bool:
        """Whether a reply is the one that the domain expects."""
        return self._bindings(activity, text) is not None

    def result(self, activity: int, text: str) -> Term | None:
        """The fact that a normal reply gives; None if the domain wants none."""
        result = self.compiled.results.get(activity)
        found = None if result is None else self._bindings(activity, text)
        return None if result is None or found is None else substitute(result, found)

    def _bindings(self, activity: int, text: str) -> Mapping[Variable, Term] | None:
        pattern = self.compiled.expects[activity]
        if pattern not in self._texts:
            self._texts[pattern] = str(pattern) if is_ground(pattern) else ""
        if self._texts[pattern]:
            return {} if self._texts[pattern] == text else None
        return matched(pattern, text)


def matched(pattern: Term, text: str) -> Mapping[Variable, Term] | None:
    """What the variables of a reply pattern are in a reply; None if it is not the one that is expected."""
    try:
        return match(pattern, ground_term(text), {})
    except AspError:
        return None


def exception_of(base: FaultModel | None, step: Function, reply: str) -> str | None:
    """The exception of the fault base that a reply to a step is; None if it knows none."""
    if base is None:
        return None
    fitting = [
        each
        for each in base.exceptions.values()
        if each.operator is None or match(each.operator, step, {}) is not None
    ]
    return next((each.name for each in fitting if each.reply == reply), None)

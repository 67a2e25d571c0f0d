"""The initial state of a problem: given facts closed, then the defaults that nothing contradicts (language, Meaning 6)."""

from engine.grounding.closure import Deduction, deduction
from engine.grounding.program import Vocabulary, deduction_rules, reachable, rule
from engine.grounding.universe import Universe
from engine.model.task import Bits, bitset
from kb.asp import Grounder
from kb.asp.vocabulary import guard, static_program
from kb.diagnostics import Diagnostic
from kb.model.problem import Problem
from kb.terms import Atom, Function


def initial_state(problem: Problem, vocabulary: Vocabulary) -> tuple[tuple[Atom, ...], list[Diagnostic]]:
    """The true fluents, and what is wrong when the given facts contradict each other."""
    if problem.complete:
        return tuple(dict.fromkeys(problem.initial)), []
    grounder = Grounder()
    grounder.ground("\n".join(_program(problem)))
    universe = Universe(grounder, vocabulary, {})
    state = _State(deduction(problem.domain, vocabulary, universe))
    state.give(bitset([universe.index[fact] for fact in problem.initial]))
    contradicted = _contradiction(problem, universe.names(state.facts & state.denied))
    for number, default in enumerate(problem.domain.defaults):
        found = grounder.atoms(f"_d_{number}", len(default.atom.arguments))
        for atom in sorted((Function(default.atom.name, arguments) for arguments in found), key=str):
            state.suppose(universe.index[atom])
    return universe.names(state.facts), contradicted


def _contradiction(problem: Problem, denied: tuple[Atom, ...]) -> list[Diagnostic]:
    if not denied:
        return []
    message = f"the initial facts deny {', '.join(map(str, denied))}"
    return [Diagnostic(problem.where, "K301", message, "remove one of the facts that exclude each other")]


def _program(problem: Problem) -> list[str]:
    text = [static_program(problem), *(f"{reachable(fact)}." for fact in problem.initial)]
    for number, default in enumerate(problem.domain.defaults):
        body = [*guard(default.parameters), *map(str, default.body)]
        text.append(rule(str(Function(f"_d_{number}", default.atom.arguments)), body))
        text.append(rule(reachable(default.atom), body))
    return text + [
        line for operator in problem.domain.deductive_operators for line in deduction_rules(operator)
    ]


class _State:
    """Facts and what they deny, growing."""

    def __init__(self, deduced: Deduction) -> None:
        self.deduced = deduced
        self.facts = self.denied = 0

    def give(self, facts: Bits) -> None:
        """Take facts as they are, with all that follows."""
        self.facts, self.denied = self.deduced.close(facts, facts)

    def suppose(self, atom: int) -> None:
        """Take a default with all that follows, unless it contradicts what is there."""
        added, denied = self.deduced.close(1 << atom, self.facts)
        if not (added & self.denied or denied & self.facts or added & denied):
            self.facts |= added
            self.denied |= denied

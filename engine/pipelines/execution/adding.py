"""What is added to a run while it goes on: further goals in words, and when objects are due and how much that counts."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from cellwright.engine.pipelines.execution.compiling import unit_ms
from cellwright.kb.commands import understand
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
from cellwright.kb.model.conditions import And, goal_parts
from cellwright.kb.model.problem import Problem
from cellwright.kb.syntax import ExpressionError, parse
from cellwright.kb.terms import Atom, Function, Number, Term

FACT = re.compile(r"\s*(\w+)\s*\(.*\)\s*", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Addition:
    """Words that are understood by themselves, and facts about times with those of the run's clock; both may be empty."""

    words: str = ""
    wishes: tuple[Atom, ...] = ()


def addition(problem: Problem, text: str, now_ms: int = 0) -> Addition:
    """What a text adds: a command in words, `due(probe_2, 40 min)`, `priority(probe_2, 3)`, separated by `;`.

    Times in it count from now on. Raises `InvalidInput`.
    """
    words, wishes = [], list[Atom]()
    for part in filter(None, map(str.strip, text.split(";"))):
        found = FACT.fullmatch(part)
        if found is not None and found[1] in _wishes(problem):
            wishes.append(_wish(problem, part, int(now_ms // unit_ms(problem.domain))))
        else:
            words.append(part)
    return Addition("; ".join(words), tuple(wishes))


def extended(problem: Problem, words: str, wishes: Sequence[Atom]) -> Problem:
    """A problem with what is added to it; a wish takes the place of an older one about the same object."""
    known = replace(problem, statics=_replaced(problem.statics, wishes)) if wishes else problem
    return merged(known, understand(known, words)) if words else known


def wished(problem: Problem) -> list[str]:
    """The facts about times among the static facts of a problem."""
    return [str(atom) for atom in problem.statics if is_wish(problem, atom)]


def is_wish(problem: Problem, atom: Atom) -> bool:
    """Whether a static fact says when an object may begin or is due, or how much that counts."""
    return atom.name in _wishes(problem)


def _wishes(problem: Problem) -> tuple[str, str, str]:
    """The domain's names for what can be wished of an object: two times, and a number."""
    words = problem.domain.conventions
    return words.due, words.release, words.priority


def _wish(problem: Problem, text: str, now: int) -> Atom:
    try:
        atom = parse("atoms", text, problem.domain.time_unit).value[0]
    except ExpressionError as error:
        raise _refused(f"'{text}' cannot be read: {error}", "write due(probe_2, 40 min)") from None
    subject, value = (*atom.arguments, None, None)[:2]
    if len(atom.arguments) != 2 or not isinstance(value, Number):
        raise _refused(f"'{text}' needs an object and a number", f"write {atom.name}(OBJECT, NUMBER)")
    if subject not in (known := _subjects(problem)):
        raise _refused(f"unknown object '{subject}'", nearest(str(subject), list(map(str, known))))
    timed = atom.name != problem.domain.conventions.priority
    return Function(atom.name, (subject, Number(value.value + now * timed)))


def _subjects(problem: Problem) -> tuple[Term, ...]:
    objects = (Function(name) for name in {**problem.domain.objects, **problem.objects})
    return tuple(dict.fromkeys((*(c.subject for c in problem.chains if c.subject is not None), *objects)))


def _replaced(statics: Sequence[Atom], wishes: Sequence[Atom]) -> tuple[Atom, ...]:
    about = {(each.name, each.arguments[0]) for each in wishes}
    kept = (each for each in statics if not each.arguments or (each.name, each.arguments[0]) not in about)
    return (*kept, *wishes)


def _refused(message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source("add"), "K107", message, hint)])


def merged(problem: Problem, further: Problem) -> Problem:
    """A problem with the goals and chains of another one; chains of the same subject come behind those that are there."""
    taken = {chain.name for chain in problem.chains}
    chains = list(problem.chains)
    for chain in further.chains:
        if chain in problem.chains:
            continue
        name = chain.name
        while name in taken:
            name = f"{name}'"
        behind = tuple(c.name for c in problem.chains if c.subject is not None and c.subject == chain.subject)
        taken.add(name)
        chains.append(replace(chain, name=name, after=tuple(dict.fromkeys((*chain.after, *behind)))))
    known = set(map(str, goal_parts(problem.goal)))
    new = [part for part in goal_parts(further.goal) if str(part) not in known]
    goal = And((*goal_parts(problem.goal), *new)) if new else problem.goal
    return replace(problem, chains=tuple(chains), goal=goal)

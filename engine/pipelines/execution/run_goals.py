"""Goals of a run: those still pursued, those given up, and those added while it goes on."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.troubleshooting import Revision
from cellwright.engine.pipelines.execution.compiled_program import unit_ms
from cellwright.engine.pipelines.planning.goal_selection import RelinquishedGoal
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.quantifiers import expand_forall
from cellwright.engine.pipelines.planning.restrictions import forbid_steps
from cellwright.engine.pipelines.recovery import WorldState
from cellwright.engine.pipelines.recovery.remaining_problem import remaining_problem
from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.kb import commands
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint
from cellwright.kb.model.conditions import ALWAYS_TRUE, And, Condition, goal_parts
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem, finished_chains
from cellwright.kb.syntax import ExpressionError, parse_expression
from cellwright.kb.terms import Atom, Function, Number, Term

FACT_PATTERN = re.compile(r"\s*(\w+)\s*\(.*\)\s*", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Addition:
    """Words that are understood by themselves, and facts about times with those of the run's
    clock; both may be empty.
    """

    words: str = ""
    wishes: tuple[Atom, ...] = ()


def read_addition(problem: Problem, text: str, now_ms: int = 0) -> Addition:
    """What a text adds: a command in words, `due(probe_2, 40 min)`, `priority(probe_2, 3)`,
    separated by `;`.

    Times in it count from now on. Raises `InvalidInput`.
    """
    words, wishes = [], list[Atom]()
    for part in filter(None, map(str.strip, text.split(";"))):
        fact = FACT_PATTERN.fullmatch(part)
        if fact is not None and fact[1] in _wish_words(problem):
            wishes.append(_read_wish(problem, part, int(now_ms // unit_ms(problem.domain))))
        else:
            words.append(part)
    return Addition("; ".join(words), tuple(wishes))


def extend_problem(problem: Problem, words: str, wishes: Sequence[Atom]) -> Problem:
    """A problem with what is added to it; a wish takes the place of an older one about the same
    object.
    """
    changed_problem = (
        replace(problem, statics=_replace_wishes(problem.statics, wishes)) if wishes else problem
    )
    return (
        merge_further_goals(changed_problem, commands.understand_command(changed_problem, words))
        if words
        else changed_problem
    )


def wished_times(problem: Problem) -> list[str]:
    """The facts about times among the static facts of a problem."""
    return [str(atom) for atom in problem.statics if is_wish(problem, atom)]


def is_wish(problem: Problem, atom: Atom) -> bool:
    """Whether a static fact says when an object may begin or is due, or how much that counts."""
    return atom.name in _wish_words(problem)


def _wish_words(problem: Problem) -> tuple[str, str, str]:
    """The domain's names for what can be wished of an object: two times, and a number."""
    words = problem.domain.conventions
    return words.due, words.release, words.priority


def _read_wish(problem: Problem, text: str, now: int) -> Atom:
    try:
        atom = parse_expression("atoms", text, problem.domain.time_unit).value[0]
    except ExpressionError as error:
        raise _addition_error(
            f"'{text}' cannot be read: {error}", "write due(probe_2, 40 min)"
        ) from None
    subject, value = (*atom.arguments, None, None)[:2]
    if len(atom.arguments) != 2 or not isinstance(value, Number):
        raise _addition_error(
            f"'{text}' needs an object and a number", f"write {atom.name}(OBJECT, NUMBER)"
        )
    if subject not in (subjects := _wish_subjects(problem)):
        raise _addition_error(
            f"unknown object '{subject}'", nearest_hint(str(subject), list(map(str, subjects)))
        )
    timed = atom.name != problem.domain.conventions.priority
    return Function(atom.name, (subject, Number(value.value + now * timed)))


def _wish_subjects(problem: Problem) -> tuple[Term, ...]:
    objects = (Function(name) for name in {**problem.domain.objects, **problem.objects})
    return tuple(
        dict.fromkeys((*(c.subject for c in problem.chains if c.subject is not None), *objects))
    )


def _replace_wishes(statics: Sequence[Atom], wishes: Sequence[Atom]) -> tuple[Atom, ...]:
    about = {(wish.name, wish.arguments[0]) for wish in wishes}
    unchanged = (
        static
        for static in statics
        if not static.arguments or (static.name, static.arguments[0]) not in about
    )
    return (*unchanged, *wishes)


def _addition_error(message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source("add"), "K107", message, hint)])


def merge_further_goals(problem: Problem, further: Problem) -> Problem:
    """A problem with the goals and chains of another one; chains of the same subject come
    behind those that are there.
    """
    taken = {chain.name for chain in problem.chains}
    chains = list(problem.chains)
    for chain in further.chains:
        if chain in problem.chains:
            continue
        name = chain.name
        while name in taken:
            name = f"{name}'"
        behind = tuple(
            c.name for c in problem.chains if c.subject is not None and c.subject == chain.subject
        )
        taken.add(name)
        chains.append(
            replace(chain, name=name, after=tuple(dict.fromkeys((*chain.after, *behind))))
        )
    old_goals = set(map(str, goal_parts(problem.goal)))
    new = [part for part in goal_parts(further.goal) if str(part) not in old_goals]
    goal = And((*goal_parts(problem.goal), *new)) if new else problem.goal
    return replace(problem, chains=tuple(chains), goal=goal)


@dataclass(frozen=True, slots=True)
class RunScope:
    """The original problem with the goals that are pursued, and what was given up of them so far,
    with reasons.

    `lost` are resources that cannot be used any more, `blocked` are patterns of steps that are not
    taken any more. `whole` is the domain with all of its steps, if some are not taken any more.
    """

    problem: Problem
    given_up: tuple[RelinquishedGoal, ...] = ()
    lost: tuple[str, ...] = ()
    blocked: tuple[Atom, ...] = ()
    whole: Domain | None = None

    def rest(self, state: WorldState) -> Problem:
        """What is left of it in a state; of a chain that is new nothing is reached."""
        reached = {chain.name: 0 for chain in self.problem.chains} | dict(state.reached)
        return remaining_problem(self.problem, reached, state.facts)

    def changed(self, revision: Revision) -> "RunScope":
        """The scope without what a case has found to be lost, or to fail, and with what a
        repair has put right.
        """
        lost = tuple(
            pattern
            for pattern in dict.fromkeys((*self.lost, *revision.lost))
            if pattern not in revision.regained
        )
        blocked = tuple(
            dict.fromkeys((*self.blocked, *(pattern for pattern, _ in revision.blocked)))
        )
        if (lost, blocked) == (self.lost, self.blocked):
            return self
        whole = self.whole or self.problem.domain
        problem = forbid_steps(replace(self.problem, domain=whole), lost, blocked)
        return RunScope(problem, self.given_up, lost, blocked, whole)

    def narrowed(
        self, left: Problem, state: WorldState, given_up: tuple[RelinquishedGoal, ...]
    ) -> "RunScope":
        """The scope after a recovery: `left` is what it plans for from a state on."""
        lengths = {
            chain.name: state.reached[chain.name] + len(chain.stages) for chain in left.chains
        }
        done = finished_chains(self.problem.chains, state.reached)
        lengths |= {
            chain.name: len(chain.stages) for chain in self.problem.chains if chain.name in done
        }
        lengths |= {
            chain.name: state.reached[chain.name]
            for chain in self.problem.chains
            if chain.name not in lengths and state.reached[chain.name]
        }
        return replace(
            self.cut(lengths, frozenset(map(str, goal_parts(left.goal)))),
            given_up=(*self.given_up, *given_up),
        )

    def cut(self, lengths: Mapping[str, int], goals: Collection[str]) -> "RunScope":
        """The scope with chains of so many stages, and with those of its goals that are named."""
        chains = tuple(
            replace(chain, stages=chain.stages[: lengths[chain.name]]).wait_only_for(lengths)
            for chain in self.problem.chains
            if lengths.get(chain.name)
        )
        wanted_goals = tuple(
            part for whole in goal_parts(self.problem.goal) for part in self._wanted(whole, goals)
        )
        goal = And(wanted_goals) if wanted_goals else ALWAYS_TRUE
        return replace(self, problem=replace(self.problem, chains=chains, goal=goal))

    def _wanted(self, whole: Condition, goals: Collection[str]) -> Iterator[Condition]:
        """A goal if it is named; else what of it is: of a goal about all objects, some may be
        left.
        """
        if str(whole) in goals:
            yield whole
        else:
            parts = goal_parts(expand_forall(replace(self.problem, goal=whole)).goal)
            yield from (part for part in parts if str(part) in goals)

    def reached(self, original: Problem, state: WorldState) -> tuple[list[str], list[str]]:
        """The goals of the original problem that are reached in a state, and the others."""
        facts = PlanGate().semantics(original).facts(state.facts)
        done, open_ = list[str](), list[str]()
        for part in goal_parts(original.goal):
            (done if condition_holds(part, facts, {}) else open_).append(str(part))
        for chain in original.chains:
            count = state.reached.get(chain.name, 0)
            done += [f"{stage} of {chain.name}" for stage in chain.stages[:count]]
            open_ += [f"{stage} of {chain.name}" for stage in chain.stages[count:]]
        return done, open_

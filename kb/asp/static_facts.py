"""The static facts of a problem, evaluated by clingo, and bounds on the instances of its rules."""

import re
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from math import inf, prod

from cellwright.kb.asp import Grounder
from cellwright.kb.asp.bounded_grounding import GroundingTooLarge
from cellwright.kb.asp.number_ranges import StaticNumbers
from cellwright.kb.asp.overflow import WatchedRule, overflows, rules_that_watch
from cellwright.kb.asp.static_program import VIOLATED, dependency_closure, static_program
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.domain_model import OBJECT_TYPE
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.statement import Sign, Signature, Statement
from cellwright.kb.plain_terms import plain_terms
from cellwright.kb.terms import ANYTHING, Atom, Function, Variable, term_variables

TRIAL_INSTANCES = 20_000_000  # instances: what may have more is grounded on trial first
UNBOUNDED_INSTANCES = 1e18  # instances: more than that is not told apart
RULE_ROUNDS = 4  # rules that build on one another, in a row
# what of a domain static facts depend on
STATIC_FIELDS = ("types", "further_parents", "functions", "objects", "predicates", "asp")
KEPT_GROUNDERS = 3  # problems whose evaluated facts are kept
# names with which a statement may begin
HEAD_NAME = re.compile(r"(?:^|\.)[\s{]*([a-z_]\w*)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Suspect:
    """An operator, rule or consequence with an upper bound on the number of its instances;
    infinite if there is none.
    """

    what: str
    where: Source
    bound: float


def evaluate_statics(problem: Problem, further: Iterable[str] = ()) -> Grounder:
    """The static facts of a problem, with `further` rules, for reading only: problems that share
    them share the grounder.

    Raises `InvalidInput` if they take too long or too much memory.
    """
    rules = tuple(further)
    for known_problem, more, grounder in _recent:
        if more == rules and _same_facts(known_problem, problem):
            return grounder
    grounder = Grounder()
    ground_statics(grounder, problem, rules)
    _recent.appendleft((problem, rules, grounder))
    return grounder


_recent: deque[tuple[Problem, tuple[str, ...], Grounder]] = deque(maxlen=KEPT_GROUNDERS)


def _same_facts(one: Problem, other: Problem) -> bool:
    """Whether two problems share their static facts, and what their domains say of these;
    operators may differ.
    """
    if any(
        getattr(one.domain, field) is not getattr(other.domain, field) for field in STATIC_FIELDS
    ):
        return False
    pairs = (one.statics, other.statics), (one.objects, other.objects)
    return all(own is others or own == others for own, others in pairs)


def ground_statics(
    grounder: Grounder,
    problem: Problem,
    further: Iterable[str] = (),
    about: Collection[str] | None = None,
) -> None:
    """Evaluate the static facts of a problem in a new grounder, with `further` rules; or those
    `about` some predicates.

    Raises `InvalidInput` as above.
    """
    rules = tuple(further)
    watched = [
        *static_rules(problem, about),
        *(WatchedRule(each, problem.where, each) for each in rules),
    ]
    text = "\n".join([static_program(problem, about), *rules, rules_that_watch(watched)])
    with within_limits(lambda: static_suspects(problem)):
        try_first(static_suspects(problem), text)
        grounder.ground(text)
    if told := list(overflows(watched, grounder)):
        raise InvalidInput(told)
    grounder.know(only_given(problem, rules))


def static_rules(problem: Problem, about: Collection[str] | None = None) -> list[WatchedRule]:
    """The rules of a problem's domain that clingo gets, or those `about` some predicates."""
    needed = None if about is None else dependency_closure(problem.domain, about)
    return [
        WatchedRule(each.text if each.defines else each.under(VIOLATED), each.where, each.text)
        for each in problem.domain.asp
        if not each.constant
        and (needed is None or (each.defines[0] if each.defines else VIOLATED) in needed)
    ]


def only_given(problem: Problem, further: Iterable[str] = ()) -> dict[Signature, dict[Atom, None]]:
    """The static atoms of each predicate about which only the problem's own facts and objects
    speak, and no rule.
    """
    domain = problem.domain
    # a name in a fact may stand for a number
    if any(statement.constant for statement in domain.asp):
        return {}
    facts: dict[Signature, dict[Atom, None]] = {}
    for name, type_ in {**domain.objects, **problem.objects}.items():
        facts.setdefault((type_, 1), {})[Function(type_, (Function(name),))] = None
    for fact in problem.statics:
        facts.setdefault((fact.name, len(fact.arguments)), {})[fact] = None
    heads = {name for text in further for name in HEAD_NAME.findall(text)}
    ruled = {statement.defines for statement in domain.asp} | {
        (own_type, 1) for type_ in domain.types for own_type in domain.parents(type_)
    }
    ruled |= {(function.result, 1) for function in domain.functions.values()}
    return {
        predicate: atoms
        for predicate, atoms in facts.items()
        if predicate not in ruled and predicate[0] not in heads
    }


def try_first(suspects: Iterable[Suspect], text: str) -> None:
    """Ground a text on trial in a process that can be ended, if a suspect may have very many
    instances. Raises `GroundingTooLarge`.
    """
    if any(suspect.bound > TRIAL_INSTANCES for suspect in suspects) and not _is_affordable(text):
        raise GroundingTooLarge


@lru_cache(maxsize=4)
def _is_affordable(text: str) -> bool:
    from cellwright.kb.asp.trial_grounding import can_be_grounded  # few programs are suspicious

    return can_be_grounded(text)


@contextmanager
def within_limits(suspects: Callable[[], Iterable[Suspect]]) -> Iterator[None]:
    """A context that reports a grounding that is too large, with the place of the worst suspect.

    Raises `InvalidInput`.
    """
    try:
        yield
    except GroundingTooLarge:
        worst = max(
            suspects(),
            key=lambda suspect: suspect.bound,
            default=Suspect("", Source("grounding"), inf),
        )
        count = "no upper bound" if worst.bound == inf else f"up to {worst.bound:.0e} instances"
        cause = f"; the most likely cause is {worst.what} ({count})" if worst.what else ""
        message = f"grounding exceeds its limit of time or memory{cause}"
        hint = "constrain its variables with types or static facts"
        raise InvalidInput([Diagnostic(worst.where, "K307", message, hint)]) from None


def static_suspects(problem: Problem) -> Sequence[Suspect]:
    """The rules of a problem's domain, each with an upper bound on its instances.

    Problems that share their facts share them.
    """
    for known_problem, known_suspects in _counted:
        if _same_facts(known_problem, problem):
            return known_suspects
    suspects = tuple(_static_suspects(problem))
    _counted.appendleft((problem, suspects))
    return suspects


_counted: deque[tuple[Problem, tuple[Suspect, ...]]] = deque(maxlen=KEPT_GROUNDERS)


def _static_suspects(problem: Problem) -> Iterator[Suspect]:
    rules = problem.domain.asp
    count = _Extents(problem)
    for _ in range(RULE_ROUNDS):
        count.grow(rules)
    for rule in rules:
        yield Suspect(rule.text, rule.where, inf if _is_endless(rule) else count.of(rule))


class _Extents:
    """Upper bounds on the number of atoms of each predicate, from what rules make of each other."""

    def __init__(self, problem: Problem) -> None:
        self.domain, self.statics = problem.domain, problem.statics
        self.ruled = {statement.defines for statement in self.domain.asp}
        self.degrees: dict[tuple[Signature, tuple[int, ...]], float] = {}
        kinds = Counter({**problem.domain.objects, **problem.objects}.values())
        self.objects = float(kinds.total())
        self.types = {type_: self._count(type_, kinds) for type_ in problem.domain.types}
        self.facts = Counter((fact.name, len(fact.arguments)) for fact in problem.statics)
        self.made: dict[Signature, float] = dict(self.facts)
        self.numbers = StaticNumbers(self.statics, self.domain.asp, self.domain.types)

    def _count(self, type_: str, kinds: Mapping[str, int]) -> float:
        """The number of objects of a type; without a bound if terms may be among its values."""
        subtype = self.domain.is_subtype
        if any(subtype(function.result, type_) for function in self.domain.functions.values()):
            return inf
        return sum(count for kind, count in kinds.items() if subtype(kind, type_))

    def grow(self, rules: Iterable[Statement]) -> None:
        """Count what the rules make of what is counted so far."""
        counts: dict[Signature, float] = dict(self.facts)
        for rule in rules:
            if rule.defines is not None:
                counts[rule.defines] = counts.get(rule.defines, 0.0) + self.of(rule)
        self.made = counts

    def of(self, rule: Statement) -> float:
        """An upper bound on the instances of a rule."""
        read = [use.predicate for use in rule.uses if use.sign is Sign.POSITIVE]
        atoms = [
            term
            for part in rule.body
            for term in plain_terms(part) or ()
            if isinstance(term, Function)
        ]
        plain = [(atom.name, len(atom.arguments)) for atom in atoms] == read
        counts = self._joined(atoms) if plain else (self._size(predicate) for predicate in read)
        range_values = min(self.numbers.count_range_values(rule), UNBOUNDED_INSTANCES)
        return min(range_values * prod(counts), UNBOUNDED_INSTANCES)

    def _size(self, predicate: Signature) -> float:
        if predicate in self.made:
            return self.made[predicate]
        if predicate[0] in self.domain.types:
            return min(self.types[predicate[0]], self.objects)
        return self.objects if predicate in self.ruled else 0.0  # nothing says anything of it

    def _joined(self, atoms: Sequence[Atom]) -> Iterator[float]:
        """For each atom of a body how many of it there can be for one binding of the variables
        before.
        """
        seen = set[Variable]()
        for atom in atoms:
            declared = self.domain.predicates.get(atom.name)
            types = declared.arguments if declared else (OBJECT_TYPE,) * len(atom.arguments)
            known_arguments, values = list[int](), 1.0
            for number, (argument, type_) in enumerate(zip(atom.arguments, types, strict=False)):
                fresh = set(term_variables(argument)) - seen
                if not fresh:
                    known_arguments.append(number)
                elif values:
                    values *= self.types.get(type_, inf) if isinstance(argument, Variable) else inf
                seen |= fresh - {ANYTHING}
            yield min(
                self._at_most((atom.name, len(atom.arguments)), tuple(known_arguments)), values
            )

    def _at_most(self, predicate: Signature, known: tuple[int, ...]) -> float:
        """How many atoms of a predicate can agree in the arguments that are known."""
        if not known or predicate not in self.facts or predicate in self.ruled:
            return self._size(predicate)
        if (predicate, known) not in self.degrees:
            facts = (f.arguments for f in self.statics if (f.name, len(f.arguments)) == predicate)
            alike = Counter(tuple(arguments[n] for n in known) for arguments in facts)
            self.degrees[predicate, known] = float(max(alike.values()))
        return self.degrees[predicate, known]


def _is_endless(rule: Statement) -> bool:
    """Whether a rule makes new terms, or counts, from what it has derived itself."""
    if rule.defines is None or rule.defines not in {use.predicate for use in rule.uses}:
        return False
    return rule.counts or "(" in rule.head[len(rule.defines[0]) + 1 :]

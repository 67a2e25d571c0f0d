"""What follows by deductive operators from one atom that is added, or ends. Static facts alone decide it, so it is remembered."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple, TypeVar

from cellwright.engine.stages.validation.changes import Denial, well_typed
from cellwright.engine.stages.validation.datalog import Bindings, solve
from cellwright.engine.stages.validation.facts import Facts
from cellwright.kb.model.conditions import Body, Literal
from cellwright.kb.model.domain import Consequence, DeductiveOperator
from cellwright.kb.terms import Atom, Function, match, substitute_atom, variables

REMEMBERED = 1 << 14  # atoms, and steps

K = TypeVar("K")
V = TypeVar("V")


class Following(NamedTuple):
    """What is added, and what is denied."""

    added: tuple[Atom, ...]
    denied: tuple[Denial, ...]

    def __bool__(self) -> bool:
        return bool(self.added or self.denied)


class Deductions:
    """The deductive operators of a domain, over static facts. `where` replaces bodies that clingo has evaluated."""

    def __init__(
        self, operators: Iterable[DeductiveOperator], statics: Facts, where: Mapping[Body, Body]
    ) -> None:
        self._triggers: dict[tuple[str, bool], list[DeductiveOperator]] = defaultdict(list)
        for each in operators:
            self._triggers[each.trigger.atom.name, each.trigger.positive].append(each)
        self._statics, self._where = statics, where
        self._known: dict[tuple[Atom, bool], Following] = {}
        self.none = not self._triggers

    def of(self, atom: Atom, positive: bool) -> Following:
        """What follows if an atom is added, or else ends, directly."""
        key = atom, positive
        known = self._known.get(key)
        return known if known is not None else remembered(self._known, key, self._follows(atom, positive))

    def _follows(self, atom: Atom, positive: bool) -> Following:
        added: list[Atom] = []
        denied: list[Denial] = []
        for deductive in self._triggers.get((atom.name, positive), ()):
            bindings = match(deductive.trigger.atom, atom, {})
            if bindings is None:
                continue
            for consequence in deductive.consequences:
                body = (*deductive.body, *consequence.body)
                body = self._where.get(body, body)
                if consequence.implied:
                    added += self._implied(consequence, body, bindings)
                elif well_typed(consequence, bindings, self._statics):
                    denied.append(Denial(consequence.atom, body, tuple(bindings.items()), consequence))
        return Following(tuple(added), tuple(denied))

    def _implied(self, consequence: Consequence, body: Body, bindings: Bindings) -> Iterator[Atom]:
        open_ = {each for each in variables(consequence.atom) if each not in bindings}
        typed = tuple(
            Literal(Function(p.type, (p.variable,))) for p in consequence.parameters if p.variable in open_
        )
        for each in solve((*typed, *body), self._statics, bindings):
            if well_typed(consequence, each, self._statics):
                yield substitute_atom(consequence.atom, each)


def remembered(known: dict[K, V], key: K, value: V) -> V:
    """A value that is remembered from now on. When too many are, all are forgotten."""
    if len(known) >= REMEMBERED:
        known.clear()
    known[key] = value
    return value

"""What a PDDL task means, by the definition of PDDL 2.1 and 2.2 alone, and by brute force. It
shares no code with the engine.

Fox & Long 2003 for actions and numbers: a comparison with a number that has no value is undefined,
and a formula that is undefined is not satisfied; `and` and `or` are those of Kleene. An action is
not applicable if an effect reads a number without a value, or if it assigns a number that it
changes otherwise as well. Edelkamp & Hoffmann 2004 for axioms.
"""

import operator
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from itertools import product
from random import Random
from typing import Any, NamedTuple

Tree = Any  # a word, or a list of trees
Env = Mapping[str, str]
Ground = tuple[str, ...]
RELATIONS: dict[str, Callable[[Fraction, Fraction], bool]] = {
    "<": operator.lt, ">": operator.gt, "<=": operator.le, ">=": operator.ge, "=": operator.eq,
}  # fmt: skip
CHANGES: dict[str, Callable[[Fraction, Fraction], Fraction]] = {
    "increase": operator.add, "decrease": operator.sub, "assign": lambda _, amount: amount,
}  # fmt: skip


class State(NamedTuple):
    """The true atoms, and the values of functions that have one."""

    atoms: frozenset[Ground]
    values: frozenset[tuple[Ground, Fraction]]


def tree(text: str) -> list[Tree]:
    """The only expression of a text."""
    stack: list[list[Tree]] = [[]]
    for token in re.findall(r"[()]|[^\s()]+", re.sub(r";[^\n]*", "", text).lower()):
        if token == "(":
            stack.append([])
        elif token == ")":
            done = stack.pop()
            stack[-1].append(done)
        else:
            stack[-1].append(token)
    (root,) = stack[0]
    assert isinstance(root, list)
    return root


def typed(parts: list[Tree]) -> list[tuple[str, Tree]]:
    """The names of a typed list, each with its type."""
    pairs: list[tuple[str, Tree]] = []
    waiting: list[str] = []
    rest = iter(parts)
    for part in rest:
        if part == "-":
            type_ = next(rest)
            pairs += [(name, type_) for name in waiting]
            waiting = []
        else:
            assert isinstance(part, str)
            waiting.append(part)
    return pairs + [(name, "object") for name in waiting]


def number(text: Tree) -> Fraction | None:
    """The number that a word is."""
    return (
        Fraction(text)
        if isinstance(text, str) and re.fullmatch(r"[+-]?[\d.]+(e[+-]?\d+)?", text)
        else None
    )


class Definition:
    """A task, and what its parts mean in a state."""

    def __init__(self, domain: str, problem: str) -> None:
        sections: dict[str, list[list[Tree]]] = {}
        for root in (tree(domain), tree(problem)):
            for part in root[1:]:
                assert isinstance(part, list)
                sections.setdefault(str(part[0]), []).append(part[1:])
        self.sections = sections
        self.above: dict[str, set[str]] = {}
        for listed in sections.get(":types", []):
            for name, at in typed(listed):
                parents = [at] if isinstance(at, str) else at[1:]
                self.above.setdefault(name, set()).update(map(str, parents))
        self.objects: dict[str, set[str]] = {}
        for listed in (*sections.get(":constants", []), *sections.get(":objects", [])):
            for name, at in typed(listed):
                self.objects.setdefault(name, set()).add(str(at))
        self.actions = {str(each[0]): each[1:] for each in sections.get(":action", [])}
        self.axioms = [(each[0], each[1]) for each in sections.get(":derived", [])]
        (goal,) = sections[":goal"][0]
        self.goal = goal
        self.levels = self._levels()
        self.functions = {
            str(each[0])
            for part in sections.get(":functions", [])
            for each in part
            if each != "-" and isinstance(each, list)
        }
        self.metric = sections.get(":metric", [[]])[0]
        self.unread = self._unread()
        self._closed: dict[State, frozenset[Ground]] = {}

    def within(self, type_: str, wanted: Tree) -> bool:
        """Whether a type is another one, or below it."""
        if isinstance(wanted, list):
            return any(self.within(type_, each) for each in wanted[1:])
        return wanted in ("object", type_) or any(
            self.within(each, wanted) for each in self.above.get(type_, ())
        )

    def of(self, wanted: Tree) -> list[str]:
        """The objects of a type."""
        return [
            name
            for name, own in self.objects.items()
            if any(self.within(each, wanted) for each in own)
        ]

    def environments(self, listed: list[Tree], env: Env) -> Iterator[Env]:
        """What the variables of a typed list may stand for."""
        pairs = typed(listed)
        for objects in product(*(self.of(type_) for _, type_ in pairs)):
            yield {
                **env,
                **{name: chosen for (name, _), chosen in zip(pairs, objects, strict=True)},
            }

    def start(self) -> State:
        """The initial state."""
        atoms, values = set(), set()
        for part in self.sections[":init"][0]:
            assert isinstance(part, list)
            if part[0] == "=":
                value = number(part[2])
                assert value is not None
                if part[1][0] in self.functions:
                    values.add((tuple(map(str, part[1])), value))
            elif part[0] != "not":
                atoms.add(tuple(map(str, part)))
        return State(frozenset(atoms), frozenset(values))

    def value(self, at: Tree, env: Env, values: Mapping[Ground, Fraction]) -> Fraction | None:
        """What an expression is worth; None if it has no value."""
        if (said := number(at)) is not None:
            return said
        if isinstance(at, str):
            return values.get((at,))
        head, *rest = at
        if head not in ("+", "-", "*", "/"):
            return values.get(ground(at, env))
        parts = [self.value(each, env, values) for each in rest]
        if any(each is None for each in parts):
            return None
        first, *others = [each for each in parts if each is not None]
        if head == "-" and not others:
            return -first
        for each in others:
            first = {"+": first + each, "-": first - each, "*": first * each}.get(
                str(head), first / (each or 1)
            )
        return first

    def truth(self, at: Tree, env: Env, state: State, closed: frozenset[Ground]) -> bool | None:
        """Whether a formula is true, false or undefined."""
        assert isinstance(at, list)
        if not at:
            return True
        head, *rest = at
        if head in ("and", "or"):
            return _joined([self.truth(each, env, state, closed) for each in rest], head == "and")
        if head == "not":
            inner = self.truth(rest[0], env, state, closed)
            return None if inner is None else not inner
        if head == "imply":
            return self.truth(["or", ["not", rest[0]], rest[1]], env, state, closed)
        if head in ("forall", "exists"):
            inside = [
                self.truth(rest[1], each, state, closed) for each in self.environments(rest[0], env)
            ]
            return _joined(inside, head == "forall")
        if head in RELATIONS and (head != "=" or any(map(self._is_number, rest))):
            left, right = (self.value(each, env, dict(state.values)) for each in rest)
            return None if left is None or right is None else RELATIONS[head](left, right)
        return self._atomic(at, env, closed)

    def _atomic(self, at: Tree, env: Env, closed: frozenset[Ground]) -> bool:
        """Whether an atom is true, or two objects are the same."""
        if at[0] == "=":
            return env.get(at[1], at[1]) == env.get(at[2], at[2])
        return ground(at, env) in closed

    def _is_number(self, at: Tree) -> bool:
        head = at if isinstance(at, str) else at[0]
        return number(head) is not None or head in (*self.functions, "+", "-", "*", "/")

    def satisfied(self, at: Tree, env: Env, state: State) -> bool:
        """Whether a formula holds in a state."""
        return self.truth(at, env, state, self.closed(state)) is True

    def closed(self, state: State) -> frozenset[Ground]:
        """The true atoms with the derived ones: the least fixed points, stratum by stratum."""
        if state not in self._closed:
            known = state.atoms
            for level in sorted(set(self.levels.values())):
                own = [each for each in self.axioms if self.levels[each[0][0]] == level]
                while more := self._derived(own, state, known) - known:
                    known |= more
            self._closed[state] = known
        return self._closed[state]

    def _derived(
        self, axioms: list[tuple[Tree, Tree]], state: State, known: frozenset[Ground]
    ) -> frozenset[Ground]:
        return frozenset(
            ground([head[0], *(name for name, _ in typed(head[1:]))], env)
            for head, body in axioms
            for env in self.environments(head[1:], {})
            if self.truth(body, env, state, known) is True
        )

    def _levels(self) -> dict[str, int]:
        levels = {str(head[0]): 0 for head, _ in self.axioms}
        for _ in range(len(levels) + 1):
            for head, body in self.axioms:
                for name, positive in _uses(body, True):
                    if name in levels:
                        levels[head[0]] = max(levels[head[0]], levels[name] + (not positive))
        return levels

    def after(self, state: State, name: str, arguments: Ground) -> State | None:
        """The state after an action; None if it is not applicable."""
        fields = dict(zip(self.actions[name][::2], self.actions[name][1::2], strict=True))
        listed = typed(fields.get(":parameters", []))
        if len(listed) != len(arguments) or any(
            each not in self.of(type_) for each, (_, type_) in zip(arguments, listed, strict=True)
        ):
            return None
        env = {variable: each for (variable, _), each in zip(listed, arguments, strict=True)}
        if not self.satisfied(fields.get(":precondition", []), env, state):
            return None
        return self._changed(state, list(self._effects(fields.get(":effect", []), env, state)))

    def _effects(self, at: Tree, env: Env, state: State) -> Iterator[tuple[Tree, Env]]:
        """The simple effects that happen."""
        if not at:
            return
        head, *rest = at
        if head == "and":
            for each in rest:
                yield from self._effects(each, env, state)
        elif head == "forall":
            for inner in self.environments(rest[0], env):
                yield from self._effects(rest[1], inner, state)
        elif head == "when":
            if self.satisfied(rest[0], env, state):
                yield from self._effects(rest[1], env, state)
        else:
            yield at, env

    def _changed(self, state: State, effects: list[tuple[Tree, Env]]) -> State | None:
        adds = {ground(at, env) for at, env in effects if at[0] not in ("not", *CHANGES)}
        deletes = {ground(at[1], env) for at, env in effects if at[0] == "not"}
        numeric = [(at, env) for at, env in effects if at[0] in CHANGES]
        values = self._values(dict(state.values), numeric)
        return (
            None
            if values is None
            else State((state.atoms - deletes) | adds, frozenset(values.items()))
        )

    def _values(
        self, before: dict[Ground, Fraction], effects: list[tuple[Tree, Env]]
    ) -> dict[Ground, Fraction] | None:
        """The values after some numeric effects; None if they cannot happen together."""
        changes: dict[Ground, list[tuple[str, Fraction]]] = {}
        for at, env in effects:
            target, amount = ground(at[1], env), self.value(at[2], env, before)
            if target[0] == "total-cost":
                before = {target: Fraction(0), **before}
            elif target[0] in self.unread:
                continue
            if amount is None or (at[0] != "assign" and target not in before):
                return None
            changes.setdefault(target, []).append((at[0], amount))
        values = dict(before)
        for target, made in changes.items():
            if len(made) > 1 and any(kind == "assign" for kind, _ in made):
                return None
            for kind, amount in made:
                values[target] = CHANGES[kind](values.get(target, Fraction(0)), amount)
        return values

    def _unread(self) -> set[str]:
        """The functions that no condition reads: what happens to them is left out.

        Costs count from 0.
        """
        conditions: list[Tree] = [self.goal, *(body for _, body in self.axioms)]
        effects: list[list[Tree]] = []
        for parts in self.actions.values():
            fields = dict(zip(parts[::2], parts[1::2], strict=True))
            conditions.append(fields.get(":precondition", []))
            for part in _parts(fields.get(":effect", [])):
                conditions += [part[1]] if part[0] == "when" else []
                effects += [part] if part[0] in ("increase", "decrease", "assign") else []
        known = {*self.functions, "total-cost"}
        read = {word for each in conditions for word in _words(each)} & known
        for _ in effects:
            read |= {
                word for at in effects if set(_words(at[1])) & read for word in _words(at[2])
            } & known
        return known - read

    def steps(self) -> Iterator[tuple[str, Ground]]:
        """All ground actions."""
        for name, parts in self.actions.items():
            fields = dict(zip(parts[::2], parts[1::2], strict=True))
            for objects in product(
                *(self.of(type_) for _, type_ in typed(fields.get(":parameters", [])))
            ):
                yield name, objects

    def walk(self, state: State, random: Random, length: int) -> Iterator[State]:
        """States on a random way from a state."""
        everything = list(self.steps())
        for _ in range(length):
            following = [
                after for each in everything if (after := self.after(state, *each)) is not None
            ]
            if not following:
                return
            state = random.choice(following)
            yield state

    def replayed(self, steps: list[tuple[str, Ground]]) -> State | None:
        """The state after some steps; None if one of them is not applicable."""
        state: State | None = self.start()
        for name, arguments in steps:
            if state is not None:
                state = self.after(state, name, arguments)
        return state

    def accepts(self, steps: list[tuple[str, Ground]]) -> bool:
        """Whether some steps are a plan."""
        state = self.replayed(steps)
        return state is not None and self.satisfied(self.goal, {}, state)

    def cost(self, steps: list[tuple[str, Ground]]) -> Fraction:
        """What a plan costs: what it adds to `total-cost` if that is minimised, else the number
        of its steps.
        """
        end = self.replayed(steps)
        assert end is not None
        return (
            dict(end.values).get(("total-cost",), Fraction(0))
            if self.metric
            else Fraction(len(steps))
        )

    def search(self, most: int) -> tuple[list[tuple[str, Ground]] | None, bool]:
        """A shortest plan, and whether the answer is certain: not more than `most` states were
        needed.
        """
        start = self.start()
        ways: dict[State, list[tuple[str, Ground]]] = {_plain(start): []}
        waiting = deque([start])
        everything = list(self.steps())
        while waiting:
            state = waiting.popleft()
            way = ways[_plain(state)]
            if self.satisfied(self.goal, {}, state):
                return way, True
            for name, arguments in everything:
                following = self.after(state, name, arguments)
                if following is not None and _plain(following) not in ways:
                    if len(ways) >= most:
                        return None, False
                    ways[_plain(following)] = [*way, (name, arguments)]
                    waiting.append(following)
        return None, True


def _plain(state: State) -> State:
    """A state without what it has cost."""
    return State(
        state.atoms, frozenset(each for each in state.values if each[0] != ("total-cost",))
    )


def _parts(at: Tree) -> Iterator[list[Tree]]:
    """All lists in a tree."""
    if isinstance(at, list) and at:
        yield at
        for each in at:
            yield from _parts(each)


def _words(at: Tree) -> Iterator[str]:
    """All words in a tree."""
    if isinstance(at, str):
        yield at
    for each in at if isinstance(at, list) else ():
        yield from _words(each)


def _joined(parts: list[bool | None], every: bool) -> bool | None:
    """`and` (every) or `or` in the logic of Kleene."""
    if (not every) in parts:
        return not every
    return None if None in parts else every


def _uses(at: Tree, positive: bool) -> Iterator[tuple[str, bool]]:
    """The predicates in a formula, and whether each stands in it without negation."""
    if not isinstance(at, list) or not at:
        return
    head, *rest = at
    if head == "not":
        yield from _uses(rest[0], not positive)
    elif head == "imply":
        yield from _uses(rest[0], not positive)
        yield from _uses(rest[1], positive)
    elif head in ("and", "or"):
        for each in rest:
            yield from _uses(each, positive)
    elif head in ("forall", "exists"):
        yield from _uses(rest[1], positive)
    else:
        yield str(head), positive


def ground(at: Tree, env: Env) -> Ground:
    """An atom or function with objects in the place of variables."""
    parts = [at] if isinstance(at, str) else at
    return tuple(env.get(str(each), str(each)) for each in parts)

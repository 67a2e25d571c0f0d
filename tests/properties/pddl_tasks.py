"""Random small PDDL tasks as text: types under several parents, shadowed names, axioms, numbers
without values, costs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from random import Random

from tests.properties.pddl_definition import Definition

VARIABLES = ("?x", "?y", "?z")
AMOUNTS = ("1", "2", "0.5", "1.5", "1e0", "3")
Env = Mapping[str, str]  # variables in scope: their types


@dataclass
class RandomTask:
    """The texts of a task that `seed` makes. With `numeric_axioms`, axioms compare numbers."""

    seed: int
    numeric_axioms: bool = False
    above: dict[str, list[str]] = field(default_factory=dict)
    objects: dict[str, list[str]] = field(default_factory=dict)
    predicates: dict[str, list[str]] = field(default_factory=dict)
    derived: dict[str, list[str]] = field(default_factory=dict)
    functions: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.random = Random(self.seed)
        self._declare()
        self.costs = self.random.random() < 0.4
        self.domain = self._domain()
        self.facts = self._facts()
        self.problem = self.with_goal(self.goal())

    def _declare(self) -> None:
        draw = self.random
        names = [f"t{n}" for n in range(draw.randint(2, 4))]
        for number, name in enumerate(names):
            pool = names[:number]
            parents = draw.sample(pool, min(len(pool), draw.choice((0, 1, 1, 2, 2))))
            self.above[name] = parents
        for number in range(draw.randint(1, 3)):
            types = draw.sample(names, min(len(names), draw.choice((1, 1, 1, 2))))
            self.objects[f"o{number}"] = draw.choice((types, types, types, ["object"]))
        types = [*names, *names, "object"]
        for number in range(draw.randint(2, 3)):
            self.predicates[f"p{number}"] = [
                draw.choice(types) for _ in range(draw.choice((0, 1, 1, 2)))
            ]
        for number in range(draw.choice((0, 0, 1, 2))):
            self.derived[f"d{number}"] = [draw.choice(types) for _ in range(draw.choice((0, 1, 1)))]
        for number in range(draw.choice((0, 1, 2, 2))):
            self.functions[f"f{number}"] = [
                draw.choice(types) for _ in range(draw.choice((0, 1, 1)))
            ]
        if self.functions and draw.random() < 0.2:  # a predicate and a function may have one name
            self.functions["p0"] = self.functions.pop("f0")

    def within(self, name: str, ancestor: str) -> bool:
        """Whether a type is within another one."""
        if name == ancestor or ancestor == "object":
            return True
        return any(self.within(each, ancestor) for each in self.above.get(name, ()))

    def _term(self, type_: str, env: Env, constants: bool) -> str:
        """A variable or an object of a type; empty if there is none."""
        fitting = [name for name, own in env.items() if self.within(own, type_)]
        if constants and (not fitting or self.random.random() < 0.15):
            fitting = [
                n
                for n, own in self.objects.items()
                if any(self.within(each, type_) for each in own)
            ]
        return self.random.choice(fitting) if fitting else ""

    def _applied(self, name: str, types: Sequence[str], env: Env, constants: bool = False) -> str:
        """An atom or function; empty if an argument is missing."""
        terms = [self._term(each, env, constants) for each in types]
        return f"({' '.join([name, *terms])})" if all(terms) else ""

    def _atom(self, env: Env, known: Mapping[str, Sequence[str]], constants: bool = False) -> str:
        for _ in range(6):
            name = self.random.choice(list(known))
            if said := self._applied(name, known[name], env, constants):
                return said
        return ""

    def _sum(self, env: Env, constants: bool) -> str:
        if not self.functions or self.random.random() < 0.4:
            return self.random.choice(AMOUNTS)
        said = self._atom(env, self.functions, constants) or self.random.choice(AMOUNTS)
        if self.random.random() < 0.25:
            return f"({self.random.choice('+-')} {said} {self._sum(env, constants)})"
        return said

    def _simple(
        self, env: Env, known: Mapping[str, Sequence[str]], constants: bool, numbers: bool
    ) -> str:
        draw = self.random.random()
        if draw < 0.3 and self.functions and numbers:
            left = self._atom(env, self.functions, constants)
            if left:
                return (
                    f"({self.random.choice(('<', '>', '<=', '>=', '='))} {left} "
                    f"{self._sum(env, constants)})"
                )
        if draw < 0.4 and len(env) > 1:
            one, other = self.random.sample(sorted(env), 2)
            return f"(= {one} {other})"
        return self._atom(env, known, constants) or "()"

    def formula(
        self,
        env: Env,
        depth: int,
        known: Mapping[str, Sequence[str]],
        constants: bool = False,
        numbers: bool = True,
    ) -> str:
        """A formula over the predicates in `known`."""
        kind = self.random.choice(
            (
                "simple",
                "simple",
                "and",
                "or",
                "not",
                "imply",
                "exists",
                "forall",
                "exists",
                "forall",
            )
        )
        if depth == 0 or kind == "simple":
            return self._simple(env, known, constants, numbers)
        if kind in ("exists", "forall"):
            listed, inner = self._listed(env)
            return (
                f"({kind} ({listed}) {self.formula(inner, depth - 1, known, constants, numbers)})"
            )
        count = {"not": 1, "imply": 2}.get(kind, self.random.randint(1, 2))
        parts = [self.formula(env, depth - 1, known, constants, numbers) for _ in range(count)]
        return f"({kind} {' '.join(parts)})"

    def _listed(self, env: Env) -> tuple[str, Env]:
        """A list of one variable, which may hide another one, and the variables in scope with
        it.
        """
        variable, type_ = self.random.choice(VARIABLES), self.random.choice([*self.above, "object"])
        said = type_
        if self.random.random() < 0.1 and len(self.above) > 1:
            said = f"(either {' '.join(self.random.sample(sorted(self.above), 2))})"
            type_ = "object"
        return variable if said == "object" else f"{variable} - {said}", {**env, variable: type_}

    def _effect(self, env: Env, depth: int) -> str:
        draw = self.random.random()
        if depth and draw < 0.2:
            listed, inner = self._listed(env)
            return f"(forall ({listed}) {self._effect(inner, depth - 1)})"
        if depth and draw < 0.4:
            return f"(when {self.formula(env, 1, self._known)} {self._effect(env, depth - 1)})"
        atom = self._atom(env, self.predicates)
        return f"(not {atom})" if atom and self.random.random() < 0.3 else atom or "()"

    def _change(self, env: Env) -> str:
        target = self._atom(env, self.functions)
        kind = self.random.choice(("increase", "increase", "decrease", "assign"))
        amount = (
            self.random.choice(AMOUNTS) if self.random.random() < 0.8 else self._sum(env, False)
        )
        return f"({kind} {target} {amount})" if target else "()"

    @property
    def _known(self) -> dict[str, list[str]]:
        return {**self.predicates, **self.derived}

    def _action(self, number: int) -> str:
        env = {
            v: self.random.choice([*self.above, "object"])
            for v in self.random.sample(VARIABLES, self.random.choice((0, 1, 1, 2)))
        }
        effects = [self._effect(env, 2) for _ in range(self.random.randint(1, 3))]
        if self.functions:
            effects += [self._change(env) for _ in range(self.random.choice((0, 1, 1, 2)))]
        if self.costs:
            effects.append(f"(increase (total-cost) {self.random.choice(AMOUNTS)})")
        listed = " ".join(f"{v} - {t}" for v, t in env.items())
        needs = self.formula(env, 2, self._known)
        said = f"(:action a{number} :parameters ({listed})"
        return f"{said}\n   :precondition {needs}\n   :effect (and {' '.join(effects)}))"

    def _axiom(self, number: int) -> str:
        """An axiom over what comes before it; it names its own predicate without negation only."""
        name = f"d{number}"
        variables = self.random.sample(VARIABLES, len(self.derived[name]))
        env = dict(zip(variables, self.derived[name], strict=True))
        known = {**self.predicates, **{f"d{n}": self.derived[f"d{n}"] for n in range(number)}}
        body = self.formula(env, 2, known, numbers=self.numeric_axioms)
        if own := self._atom(env, {name: self.derived[name]}):
            body = self.random.choice(
                (body, body, f"(or {body} (and {own} {self._atom(env, known) or '()'}))")
            )
        listed = " ".join(f"{v} - {t}" for v, t in env.items())
        return f"(:derived ({name} {listed}) {body})"

    def _domain(self) -> str:
        typing = []
        for name, parents in self.above.items():
            if len(parents) == 2 and self.random.random() < 0.3:
                typing.append(f"{name} - (either {' '.join(parents)})")
            else:
                typing += [f"{name} - {each}" for each in parents] or [f"{name} - object"]
        self.random.shuffle(typing)
        signatures = [
            f"({name} {' '.join(f'?a{n} - {type_}' for n, type_ in enumerate(types))})"
            for name, types in self._known.items()
        ]
        functions = [
            f"({name} {' '.join(f'?a{n} - {type_}' for n, type_ in enumerate(types))})"
            for name, types in self.functions.items()
        ]
        actions = [self._action(number) for number in range(self.random.randint(1, 3))]
        axioms = [self._axiom(number) for number in range(len(self.derived))]
        functions += ["(total-cost)"] if self.costs else []
        parts = [
            "(:requirements :adl :derived-predicates :numeric-fluents)",
            f"(:types {' '.join(typing)})",
            f"(:predicates {' '.join(signatures)})",
            f"(:functions {' '.join(functions)})" if functions else "",
            *axioms,
            *actions,
        ]
        return "(define (domain d)\n  " + "\n  ".join(filter(None, parts)) + ")\n"

    def _facts(self) -> list[str]:
        """What is true at the start."""
        facts = []
        for name, types in self.predicates.items():
            for _ in range(2):
                fact = self._applied(name, types, {}, constants=True)
                facts += [fact] if fact and self.random.random() < 0.4 else []
        values: dict[str, str] = {}
        for name, types in self.functions.items():
            for _ in range(3):
                target = self._applied(name, types, {}, constants=True)
                if target and self.random.random() < 0.6:
                    values.setdefault(target, self.random.choice(("0", "1", "2", "0.5", "-1")))
        facts += [f"(= {target} {value})" for target, value in values.items()]
        facts += ["(= (total-cost) 0)"] if self.costs and self.random.random() < 0.8 else []
        return list(dict.fromkeys(facts))

    def goal(self) -> str:
        """A goal; each call makes another one."""
        parts = [
            self.formula({}, 2, self._known, constants=True)
            for _ in range(self.random.randint(1, 2))
        ]
        return f"(and {' '.join(parts)})"

    def with_goal(self, goal: str) -> str:
        """The problem file with this goal."""
        objects = [f"{name} - {type_}" for name, types in self.objects.items() for type_ in types]
        parts = [
            "(:domain d)",
            f"(:objects {' '.join(objects)})",
            f"(:init {' '.join(self.facts)})",
            f"(:goal {goal})",
            "(:metric minimize (total-cost))" if self.costs else "",
        ]
        return "(define (problem p)\n  " + "\n  ".join(filter(None, parts)) + ")\n"


def random_task(seed: int, numeric_axioms: bool = False, tries: int = 30) -> tuple[str, str]:
    """Domain and problem of a random task.

    Its goal does not hold at the start, and most often something reaches it.
    """
    task = RandomTask(seed, numeric_axioms)
    wanted = Random(seed).random() < 0.8
    for _ in range(tries):
        definition = Definition(task.domain, task.problem)
        start = definition.start()
        visited = list(definition.walk(start, Random(seed), 12)) if wanted else []
        holds = definition.satisfied(definition.goal, {}, start)
        if not holds and (
            not wanted or any(definition.satisfied(definition.goal, {}, each) for each in visited)
        ):
            break
        task.problem = task.with_goal(task.goal())
    return task.domain, task.problem

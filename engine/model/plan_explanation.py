"""Why there is no plan and which changes would allow one; why a step is in a plan."""

from dataclasses import dataclass

from cellwright.kb.model.plan_model import CausalLink, Step
from cellwright.kb.terms import Atom


@dataclass(frozen=True, slots=True)
class Edit:
    """One fact that is different: `added` is new, `removed` is gone. With both, one stands in place
    of the other.

    `layer` is static, initial or object. A fact about an object is its type with its name:
    `laser(slra)`.
    """

    layer: str
    added: Atom | None = None
    removed: Atom | None = None

    @property
    def verb(self) -> str:
        """Add, remove or change."""
        return "remove" if self.added is None else "add" if self.removed is None else "change"

    @property
    def fact(self) -> Atom:
        """The new fact, or the one that is removed."""
        fact = self.added or self.removed
        assert fact is not None
        return fact

    def __str__(self) -> str:
        instead = f" instead of {self.removed}" if self.verb == "change" else ""
        return f"{self.verb} {self.layer} {self.fact}{instead}"


@dataclass(frozen=True, slots=True)
class Amendment:
    """A change to a problem: edits of facts, a goal that is dropped, or events (`stages`) that are
    asked for as well.

    `proof` is the number of steps of a checked plan for the changed problem. `missing` leads from
    the goal down to what the edits give.
    """

    edits: tuple[Edit, ...] = ()
    goal: str = ""
    proof: int = 0
    missing: tuple[str, ...] = ()
    stages: tuple[Atom, ...] = ()

    @property
    def kind(self) -> str:
        """Such as `add static` or `change initial`; `drop goal` or `add stage`."""
        if self.stages:
            return "add stage"
        kinds = dict.fromkeys(f"{edit.verb} {edit.layer}" for edit in self.edits)
        return " and ".join(kinds) if self.edits else "drop goal"

    @property
    def facts(self) -> tuple[Atom, ...]:
        """The fact of each edit, or the events that are asked for."""
        return self.stages or tuple(edit.fact for edit in self.edits)

    def __str__(self) -> str:
        if self.stages:
            return f"add stage {', '.join(map(str, self.stages))}"
        return ", ".join(map(str, self.edits)) or f"drop goal {self.goal}"


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why there is no plan. `status` is feasible, infeasible or unknown.

    `goals` is a minimal set of goals that cannot be reached (together, if there are several).
    `exclusions` say what is never true at the same time: pairs of these, or needs of the step that
    would reach the only one. `changes` are the smallest ones; each is proved by a plan. `untried`
    is how many changes that might help were left when a limit was reached. `gaps` say what no
    operator makes true; they are told where no change of facts helps. `fewer` says that any fewer
    of several goals have a plan; else that was not decided. `obstacles` say which facts are in the
    way, and of which things. `relaxed` are windows of time with what they would have to allow, so
    that there is a plan of `relaxed_steps` steps.
    """

    status: str
    goals: tuple[str, ...] = ()
    exclusions: tuple[str, ...] = ()
    changes: tuple[Amendment, ...] = ()
    reason: str = ""
    untried: int = 0
    gaps: tuple[str, ...] = ()
    fewer: bool = True
    obstacles: tuple[str, ...] = ()
    relaxed: tuple[str, ...] = ()
    relaxed_steps: int = 0


@dataclass(frozen=True, slots=True)
class Purpose:
    """A step achieves `condition` for `consumer` (None if it is a goal).

    Through the causal links in `links` this serves a goal.
    """

    condition: Atom
    consumer: Step | None
    links: tuple[CausalLink, ...]


@dataclass(frozen=True, slots=True)
class OrderReason:
    """Why one step comes before another."""

    earlier: Step
    later: Step
    reason: str


@dataclass(frozen=True, slots=True)
class StepReason:
    """Why a step is in a plan, and why it has its place in the order."""

    step: Step
    purposes: tuple[Purpose, ...]
    orders: tuple[OrderReason, ...]

"""Contact states as Petri nets: tokens, clusters, places, transitions, and nets for PNML."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.kb.model.contact_model import ContactModel, Octuple, Restriction


@dataclass(frozen=True, slots=True)
class PetriPlace:
    """A place. `marking` lists the tokens at the start; in a place/transition net `count` is their
    number.

    `notes` are what only this engine reads: template, capacities.
    """

    id: str
    name: str
    count: int = 0
    marking: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PetriTransition:
    """A transition. `variables` gives the type of each variable of its arcs; its guard demands
    them.
    """

    id: str
    name: str
    variables: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PetriArc:
    """An arc. It moves `count` tokens or, in a symmetric net, those that its `variables` are
    bound to.
    """

    id: str
    source: str
    target: str
    count: int = 1
    variables: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PetriNet:
    """A net; `types` parts the class of tokens of a symmetric net, and is empty for a
    place/transition net.
    """

    id: str
    places: tuple[PetriPlace, ...]
    transitions: tuple[PetriTransition, ...]
    arcs: tuple[PetriArc, ...]
    types: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def coloured(self) -> bool:
        """Whether it is a symmetric net."""
        return bool(self.types)


@dataclass(frozen=True, slots=True)
class AnchorSlot:
    """Exchangeable anchor points of one object of a token.

    `several`: the object has more of this anchor class.
    """

    position: int  # of the object in its token
    anchor_class: str
    anchors: tuple[str, ...]
    key: bool
    several: bool


@dataclass(frozen=True, slots=True)
class TokenType:
    """A colour: exchangeable permanent clusters.

    `members` are the tokens, each a tuple of its objects; `classes` are the classes of these
    objects. A token is `fixed` if no joint moves it, `passive` if only a passive joint does.
    `driven` are the positions that controllable joints move.
    """

    name: str
    members: tuple[tuple[str, ...], ...]
    classes: tuple[str, ...]
    slots: tuple[AnchorSlot, ...]
    fixed: bool = False
    passive: bool = False
    driven: frozenset[int] = frozenset()

    @property
    def anchored(self) -> bool:
        """Whether the token stays where it is without a transient contact."""
        return self.fixed or self.passive or bool(self.driven)

    @property
    def loose(self) -> bool:
        """Whether the token can be carried from place to place."""
        return not (self.fixed or self.passive)

    def slot_name(self, slot: int) -> str:
        """What a slot is called in names of operators and tables."""
        return self.classes[self.slots[slot].position]


@dataclass(frozen=True, slots=True, order=True)
class ContactEdge:
    """A transient contact in a cluster: node and slot of the key, node and slot of the lock,
    and the contact class.
    """

    key: int
    key_slot: int
    lock: int
    lock_slot: int
    kind: str

    def shifted(self, by: int) -> "ContactEdge":
        """The edge with its nodes counted from `by`."""
        return ContactEdge(self.key + by, self.key_slot, self.lock + by, self.lock_slot, self.kind)


@dataclass(frozen=True, slots=True)
class TokenCluster:
    """Coupled tokens: the type of each node, and the contacts between them."""

    nodes: tuple[int, ...]
    edges: tuple[ContactEdge, ...] = ()


@dataclass(frozen=True, slots=True)
class ClusterForm:
    """A cluster up to exchanges.

    `symmetries` counts the exchanges that leave it as it is; nodes of one orbit are alike.
    """

    cluster: TokenCluster
    symmetries: int
    orbits: tuple[int, ...]


@dataclass(frozen=True, slots=True, order=True)
class ContactStep:
    """One contact changes: forms become other forms. `ends` are type and slot of key and lock.

    `moved` says, for each token of a type, from which input to which output it goes: (input,
    output, type, count).
    """

    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    makes: bool
    kind: str
    ends: tuple[tuple[int, int], tuple[int, int]]
    moved: tuple[tuple[int, int, int, int], ...] = ()


@dataclass(frozen=True, slots=True)
class Removed:
    """A cluster that a filter did not let pass, and why."""

    filter: str
    reason: str
    contacts: tuple[Octuple, ...]


@dataclass(frozen=True, slots=True)
class NetPlace:
    """What clusters have in common.

    `contacts` is its template in the normal form; `capacity` counts tokens by type.
    """

    name: str
    say: str
    contacts: tuple[Octuple, ...]
    capacity: tuple[tuple[str, int], ...]
    robot: bool
    forms: tuple[int, ...]
    initial: int = 0  # clusters in it at the start
    tokens: tuple[tuple[str, int], ...] = ()  # tokens in it at the start, by type


@dataclass(frozen=True, slots=True)
class Transfer:
    """The tokens of a type that a transition moves from an input place to an output place;
    `most` if their number varies.
    """

    source: str
    target: str
    type: str
    least: int
    most: int


@dataclass(frozen=True, slots=True)
class Transition:
    """An operator: it makes or breaks a contact of `contact` (a second-order template or finer).

    `cases` say when it can: in clusters with these contacts and free anchor points, of which the
    first is the one that changes.
    """

    name: str
    say: str
    operator: str
    makes: bool
    contact: Octuple
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    transfers: tuple[Transfer, ...]
    restrictions: tuple[Restriction, ...] = ()
    reversible: bool = True
    cases: tuple[tuple[Octuple, ...], ...] = ()
    steps: tuple[ContactStep, ...] = ()


@dataclass(frozen=True, slots=True)
class StateGrowth:
    """How many fully specified global contact states there are; `exact` unless the count is an
    upper bound.

    `classes` counts them up to exchanges of alike objects and anchor points; None if the search for
    them was stopped.
    """

    states: int
    exact: bool
    classes: int | None


@dataclass(frozen=True)
class FormSpace:
    """Everything that was generated: forms, the steps between them, and what filters removed."""

    model: ContactModel
    types: tuple[TokenType, ...]
    forms: tuple[ClusterForm, ...]
    steps: tuple[ContactStep, ...]
    initial: tuple[int, ...]
    removed: tuple[Removed, ...]
    complete: bool = True

    @cached_property
    def by_inputs(self) -> Mapping[tuple[int, ...], tuple[ContactStep, ...]]:
        """The steps by their inputs, which stand in ascending order."""
        steps_by_inputs: dict[tuple[int, ...], list[ContactStep]] = {}
        for step in self.steps:
            steps_by_inputs.setdefault(step.inputs, []).append(step)
        return {inputs: tuple(steps) for inputs, steps in steps_by_inputs.items()}


@dataclass(frozen=True, slots=True)
class StateRegion:
    """Contact states that can all be reached from each other.

    `fused` are the one-way contacts that hold or are gone in it.
    """

    states: int
    fused: tuple[str, ...]
    exits: int
    dead: bool  # no step leads on


@dataclass(frozen=True, slots=True)
class ContactNet:
    """The net of a cell: places, transitions, and what is known of the whole.

    `joints` lists, for each joint with settings, the places in which it may be manipulated.
    """

    name: str
    places: tuple[NetPlace, ...]
    transitions: tuple[Transition, ...]
    colours: Mapping[str, tuple[str, ...]]
    joints: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    removed: tuple[Removed, ...] = ()
    growth: StateGrowth = StateGrowth(0, False, None)
    regions: tuple[StateRegion, ...] = ()
    complete: bool = True


@dataclass(frozen=True, slots=True)
class ObjectShare:
    """What one object brings to a cell: how many places, transitions and fully specified
    states; which states filters removed.
    """

    part: str
    places: int
    transitions: int
    states: int
    removed: tuple[tuple[str, str], ...]

"""Small cells for tests, and a slow search of their contact states that knows neither forms nor
symmetries.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product

from hypothesis import strategies as st

from cellwright.kb.model.contact_model import (
    AnchorPoint,
    ContactClass,
    ContactModel,
    ObjectClass,
    Octuple,
    OneWay,
    PermanentContact,
    Quadruple,
    Undesirable,
    class_of,
    parse_octuple,
)

State = frozenset[Octuple]
SIDES = {"hand": True, "grip": False, "foot": True, "seat": False, "peg": True, "hole": False}


def kind(name: str, *anchors: tuple[str, str]) -> ObjectClass:
    """An object class with anchor points (name, anchor class)."""
    points = {point: AnchorPoint(point, of, SIDES[of]) for point, of in anchors}
    return ObjectClass(name, (name,), points)


@dataclass(frozen=True)
class Recipe:
    """How a random cell is made."""

    robots: int
    seats: tuple[int, ...]  # of each device
    passive: bool  # whether the first device is a drawer
    blocks: int
    rings: int
    one_way: OneWay
    gravity: bool
    barred: bool


recipes = st.builds(
    Recipe,
    st.integers(1, 2),
    st.lists(st.integers(1, 3), min_size=1, max_size=2).map(tuple),
    st.booleans(),
    st.integers(0, 2),
    st.integers(0, 2),
    st.sampled_from(list(OneWay)),
    st.booleans(),
    st.booleans(),
).filter(
    lambda each: (
        each.blocks + each.rings <= sum(each.seats) <= 4
        and 1 <= each.blocks + each.rings + each.robots <= 4
    )
)


def cell(recipe: Recipe) -> ContactModel:
    """Robots, devices with seats, blocks with a hole, and rings with a peg that goes into the
    hole.
    """
    classes = {
        "robot": kind("robot", ("jaw", "hand")),
        "block": kind("block", ("ear", "grip"), ("foot", "foot"), ("hole", "hole")),
        "ring": kind("ring", ("ear", "grip"), ("foot", "foot"), ("peg", "peg")),
    }
    objects, permanent = {}, {}
    for n in range(recipe.robots):
        objects[f"robot_{n}"] = "robot"
        permanent[f"arm_{n}"] = PermanentContact(
            f"arm_{n}", "ground", f"robot_{n}", ("turn z",), True
        )
    seats = []
    for n, count in enumerate(recipe.seats):
        name = f"device_{n}"
        handle = [("handle", "grip")] if n == 0 and recipe.passive else []
        classes[name] = kind(name, *((f"seat_{i}", "seat") for i in range(count)), *handle)
        objects[name] = name
        freedom = ("slide x",) if handle else ()
        permanent[f"mount_{n}"] = PermanentContact(f"mount_{n}", "ground", name, freedom)
        seats += [Quadruple(name, name, "seat", f"seat_{i}") for i in range(count)]
    parts = [("block", n) for n in range(recipe.blocks)] + [
        ("ring", n) for n in range(recipe.rings)
    ]
    initial = []
    for (of, n), seat in zip(parts, seats, strict=False):
        objects[f"{of}_{n}"] = of
        initial.append(Octuple(Quadruple(of, f"{of}_{n}", "foot", "foot"), seat))
    return ContactModel(
        "random",
        classes,
        objects,
        {
            "hold": contact_class("hold", "*:*.hand:* - *:*.grip:*", controllable=True),
            "seat": contact_class("seat", "*:*.foot:* - *:*.seat:*"),
            "mesh": contact_class("mesh", "*:*.peg:* - *:*.hole:*", one_way=recipe.one_way),
        },
        permanent,
        tuple(initial),
        (Undesirable("no_ring_in_hand_on_device_0", BARRED),) if recipe.barred else (),
        gravity=recipe.gravity,
    )


BARRED = (
    parse_octuple("robot:*.hand:* - ring:R.grip:*"),
    parse_octuple("ring:R.foot:* - device_0:*.seat:*"),
)


def contact_class(
    name: str, template: str, controllable: bool = False, one_way: OneWay = OneWay.NO
) -> ContactClass:
    return ContactClass(
        name,
        parse_octuple(template),
        f"make_{name}",
        f"break_{name}",
        (),
        controllable,
        one_way=one_way,
    )


def starts(model: ContactModel) -> set[State]:
    """The start with alike objects, and alike anchor points, exchanged in every way."""
    groups: dict[str, list[str]] = {}
    for name, of in model.objects.items():
        groups.setdefault(of, []).append(name)
    found = {frozenset(model.initial)}
    for names in groups.values():
        found = {
            frozenset(_renamed(each, dict(zip(names, order, strict=True))) for each in state)
            for state in found
            for order in permutations(names)
        }
    for name, of in model.objects.items():
        several: dict[str, list[str]] = {}
        for anchor in model.classes[of].anchors.values():
            several.setdefault(anchor.anchor_class, []).append(anchor.name)
        for anchors in several.values():
            found = {
                frozenset(
                    _moved(each, name, dict(zip(anchors, order, strict=True))) for each in state
                )
                for state in found
                for order in permutations(anchors)
            }
    return found


def _renamed(contact: Octuple, names: dict[str, str]) -> Octuple:
    ends = (
        Quadruple(p.object_class, names.get(p.instance, p.instance), p.anchor_class, p.anchor)
        for p in (contact.first, contact.second)
    )
    return Octuple(*ends)


def _moved(contact: Octuple, name: str, anchors: dict[str, str]) -> Octuple:
    ends = (
        Quadruple(
            p.object_class,
            p.instance,
            p.anchor_class,
            anchors.get(p.anchor, p.anchor) if p.instance == name else p.anchor,
        )
        for p in (contact.first, contact.second)
    )
    return Octuple(*ends)


class Slow:
    """Contact states one by one, by rules as plain as they can be."""

    def __init__(self, model: ContactModel) -> None:
        self.model = model
        self.robots = {name for name, of in model.objects.items() if of == "robot"}
        self.fixed = {name for name, of in model.objects.items() if of.startswith("device")}
        self.points = [
            model.point(name, anchor)
            for name, of in model.objects.items()
            for anchor in model.classes[of].anchors
        ]

    def group(self, state: State, name: str) -> set[str]:
        """All objects that are coupled with one."""
        found = {name}
        while True:
            more = {
                p.instance
                for c in state
                for p in (c.first, c.second)
                if {c.first.instance, c.second.instance} & found
            }
            if more <= found:
                return found
            found |= more

    def sound(self, state: State) -> bool:
        """Whether nothing falls and nothing is barred."""
        for name in self.model.objects:
            if self.model.gravity and not self.group(state, name) & (self.robots | self.fixed):
                return False
        if self.model.undesirable:
            held = {
                c.second.instance
                for c in state
                if c.first.anchor_class == "hand" and c.second.object_class == "ring"
            }
            on = {
                c.first.instance
                for c in state
                if c.second.object_class == "device_0"
                and c.first.object_class == "ring"
                and c.second.anchor_class == "seat"
            }
            return not held & on
        return True

    def can_change(self, without: State, contact: Octuple) -> bool:
        """Whether a robot can bring the two parts together, or take them apart."""
        first, second = (
            self.group(without, each.instance) for each in (contact.first, contact.second)
        )
        if first & second:
            return False
        return any(side & self.robots and not side & self.fixed for side in (first, second))

    def following(self, state: State) -> Iterator[tuple[Octuple, State]]:
        classes = self.model.contact_classes
        for contact in state:
            found = class_of(contact, classes, self.model.classes)
            assert found is not None
            after = state - {contact}
            if (
                found.one_way is not OneWay.MAKING
                and self.can_change(after, contact)
                and self.sound(after)
            ):
                yield contact, after
        taken = {p for c in state for p in (c.first, c.second)}
        free = [p for p in self.points if p not in taken]
        for key, lock in product(free, free):
            contact = Octuple(key, lock)
            if (
                key.instance == lock.instance
                or not SIDES[key.anchor_class]
                or SIDES[lock.anchor_class]
            ):
                continue
            found = class_of(contact, classes, self.model.classes)
            if (
                found is None
                or found.one_way is OneWay.BREAKING
                or not self.can_change(state, contact)
            ):
                continue
            after = state | {contact}
            if self.sound(after):
                yield contact, after

    def reachable(self) -> dict[State, set[Octuple]]:
        """Every state that can be reached from any exchange of the start, with the contacts
        that can change in it.
        """
        found: dict[State, set[Octuple]] = {}
        open_ = list(starts(self.model))
        seen = set(open_)
        while open_:
            state = open_.pop()
            found[state] = set()
            for contact, after in self.following(state):
                found[state].add(contact)
                if after not in seen:
                    seen.add(after)
                    open_.append(after)
        return found

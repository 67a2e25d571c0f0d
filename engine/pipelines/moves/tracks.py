"""What each arm is in the way of: where it is, with all that rides on it, on its way through each step and at rest between steps."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.moves import Leg, LegKind, MovedStep
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.plan import StepId

Key = tuple[tuple[str, bytes], ...]


@dataclass(frozen=True, eq=False)
class Rider:
    """An arm with all that moves with it, in a world: what it holds, and what carries it."""

    world: World
    arm: str

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        """The arm's links, and the bodies that ride on it, that carry it, or that ride on these."""
        world, arm = self.world, self.arm
        below = [each for each in world.supports(f"{arm}.base")[1:] if each in world.cell.bodies]
        moving = {each for each in below if world.cell.bodies[each].guide is not None}
        others = {f"{name}." for name in world.cell.arms if name != arm}
        links = [f"{arm}.{link.name}" for link in world.cell.arms[arm].arm.links]
        return (*links, *(body for body in world.cell.bodies if self._rides(body, moving, tuple(others))))

    def _rides(self, body: str, moving: set[str], others: tuple[str, ...]) -> bool:
        chain = self.world.supports(body)
        if any(each.startswith(others) for each in chain):
            return False
        return any(each.startswith(f"{self.arm}.") or each in moving for each in chain)

    @cached_property
    def key(self) -> Key:
        """What tells two such arms apart: where everything is on them."""
        placed = self.world.placed
        own = [body for body in self.bodies if body in placed]
        return tuple(
            (f"{body}:{placed[body].parent}", placed[body].T_parent_frame.tobytes())
            for body in (*own, f"{self.arm}.base")
        )


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """A path (m, k) of an arm, with what rides on it all the way."""

    rider: Rider
    path: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Occupied:
    """What one arm does in one step: its passages, the last of which ends where it rests then; whether it rides along a rail."""

    step: StepId
    arm: str
    passages: tuple[Passage, ...]
    rest: Passage
    rides: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """A step of the plan with the cell before and after it, with all arms, and its motion if it has one."""

    step: StepId
    before: World
    after: World
    moved: MovedStep | None
    arms: tuple[str, ...]


def tracks(moments: Sequence[Moment], homes: Mapping[str, Floats]) -> dict[str, list[Occupied]]:
    """For each arm what it does, step by step."""
    now = dict(homes)
    found: dict[str, list[Occupied]] = {arm: [] for arm in homes}
    for each in moments:
        for arm in each.arms if each.moved is not None else ():
            assert each.moved is not None
            passages = tuple(passages_of(each, arm, now[arm]))
            rides = any(leg.kind is LegKind.DRIVE and leg.arm == arm for leg in each.moved.legs)
            now[arm] = passages[-1].path[-1]
            rest = Passage(passages[-1].rider, now[arm][None])
            found[arm].append(Occupied(each.step, arm, passages, rest, rides))
    return found


def passages_of(moment: Moment, arm: str, q: Floats) -> Iterator[Passage]:
    """Where an arm is in a step, from its configuration `q` (k,) on; at its end with what it holds then."""
    assert moment.moved is not None
    before, after = Rider(moment.before, arm), Rider(moment.after, arm)
    yield Passage(before, q[None])
    for leg in _own(moment.moved.legs, arm):
        q = leg.path[-1]
        if leg.kind is LegKind.DRAG:
            body = _dragged(moment, arm)
            held = moment.before.moved(arm, leg.path[0])
            yield Passage(Rider(held.affix(body, f"{arm}.tool") if body else held, arm), leg.path)
        elif leg.kind is LegKind.CARRY:
            held = moment.before.moved(arm, leg.path[0])
            for body in leg.holding:
                held = held.affix(body, f"{arm}.tool") if body in held.cell.bodies else held
            yield Passage(Rider(held, arm), leg.path)
        else:
            yield Passage(after if leg.kind is LegKind.OUT else before, leg.path)
    yield Passage(after, q[None])


def _own(legs: Sequence[Leg], arm: str) -> Iterator[Leg]:
    for leg in legs:
        for each in (leg, *leg.beside):
            if each.arm == arm:
                yield each


def _dragged(moment: Moment, arm: str) -> str:
    """The body whose place along its joint a step changes, in whose place the arm is; empty if none."""
    for name, body in moment.before.cell.bodies.items():
        moved = moment.before.placed[name].T_parent_frame, moment.after.placed[name].T_parent_frame
        own = any(each.startswith(f"{arm}.") for each in moment.before.supports(name))
        if body.guide is not None and not body.guide.follows and not own and not np.array_equal(*moved):
            return name
    return ""

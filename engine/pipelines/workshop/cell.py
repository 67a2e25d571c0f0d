"""A cell that places parts by physics: what is believed of it, what steps, tests and repairs do in it, and what they answer.

A step is planned on what is believed, and carried out in what is there. Tests and repairs really look, lift and close.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cellwright.engine.kernels.rigid import difference
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.vision import Located, Sighting
from cellwright.engine.pipelines.placing.answers import Carry
from cellwright.engine.pipelines.placing.camera_cell import camera_answer
from cellwright.engine.pipelines.placing.doubt import brought, within_m
from cellwright.engine.pipelines.placing.looking import Looked
from cellwright.engine.pipelines.placing.ordering import Key, Ordered, key_of, move_of
from cellwright.engine.pipelines.placing.placing import STILL_M, STILL_RAD, likeliest
from cellwright.engine.pipelines.placing.site import Site
from cellwright.engine.pipelines.placing.yard import Move, Obstacle, Spot, Yard
from cellwright.engine.pipelines.workshop.carrying import Went, carry_out, searched_on
from cellwright.engine.pipelines.workshop.eyes import Eyes
from cellwright.engine.pipelines.workshop.shop import Workshop
from cellwright.engine.stages.diagnosis.knowledge import CURED, NOT_CURED
from cellwright.kb.asp import ground_term
from cellwright.kb.model.faults import FaultModel
from cellwright.kb.terms import Function

NO_WAY = "no_way"  # no reply of the fault base: the order of the steps is made anew
UNSURE = "unsure"  # the reply where a part may come to lie too far from its goal
CLOSED_M = 0.003  # fingers that are nearer to each other hold nothing


@dataclass
class PlacingCell:
    """The belief (`yard`, `spots`, `seen`), and the workshop where things are as they are. `model` is the domain's fault base."""

    yard: Yard
    shop: Workshop
    eyes: Eyes
    model: FaultModel
    seen: dict[str, Sighting]
    spots: dict[str, Spot]
    known: dict[Key, tuple[Carry, ...]] = field(default_factory=dict)
    about: str = ""  # the part of the last step
    refused: Obstacle | None = None  # why a step has no motion
    held: Carry | None = None  # how the part is held that did not go into its hole

    def expect(self, order: Ordered) -> None:
        """The motions of a plan are carried out as they were proved, as long as they fit."""
        spots, near = dict(self.spots), self.near()
        for move, carries in order.moves:
            self.known[key_of(move, spots, near)] = carries
            spots[move.part], near = move.end, carries[-1].legs[-1].path[-1]

    def take(self, text: str, expects: str, part: Sequence[float] = ()) -> str | None:  # noqa: ARG002 - it moves bodies, not parts
        """Carry out a step: its reply."""
        step = _instance(text)
        if (said := self.eyes.seeing.carry_out(step.name)) is not None:
            return self._see_all() if step.name == "take_depth_map" else said
        move = move_of(step)
        self.about = move.part
        carries = self._planned(move)
        if isinstance(carries, Obstacle):
            self.refused = carries
            return NO_WAY
        if move.end is Spot.GOAL:
            doubted = self._doubted(move, carries)
            if within_m(doubted) > self.yard.site.scene.tolerance_m:
                return UNSURE
            fit = self.yard.insertion(move, self.spots, doubted, carries[-1].T_part_hand)
            carries = (*carries[:-1], replace(carries[-1], insertion=fit))
        for carry in carries:
            went = carry_out(self.shop, move.part, carry)
            if went is not Went.DONE:
                self.held = carry if self.shop.load == move.part else None
                return went
        self.spots[move.part] = move.end
        return expects or "done"

    def _planned(self, move: Move) -> tuple[Carry, ...] | Obstacle:
        near = self.near()
        key = key_of(move, self.spots, near)
        found = self.known.get(key) or self.yard.moved(move, self.spots, near)
        if not isinstance(found, Obstacle):
            self.known[key] = found
        return found

    def near(self) -> Floats:
        """Where the arm is: all joints of the world (k,)."""
        return self.yard.site.world.moved(self.shop.arm, self.shop.q).configuration

    def _doubted(self, move: Move, carries: Sequence[Carry]) -> Floats:
        """The covariance (6, 6) of where the part will be."""
        sighting = self.seen[move.part]
        assert isinstance(sighting, Located)
        return brought(sighting, carries, self.yard.pose(move.part, move.end))

    def told(self) -> Mapping[str, Any]:
        """Replies tell nothing beside their text."""
        return {}

    def missing(self, looked_at: Sequence[str]) -> str:  # noqa: ARG002 - the domain has no conditions that are watched
        """The first of some facts that is not so; none is looked at here."""
        return ""

    def say(self, choices: Sequence[str]) -> str:
        """What a person answers, who has looked and seen nothing else."""
        return choices[-1] if choices else "done"

    def answer(self, action: str) -> str:
        """The outcome of a test or a repair."""
        acts: Mapping[str, Callable[[], str]] = {
            "look_again": self._look_again,
            "look_from_the_hand": self._look_near,
            "look_at_the_goal": self._look_at_goal,
            "look_along_the_way": self._look_along,
            "close_on_nothing": self._close,
            "find_and_plan_anew": self._find,
            "search_for_the_hole": self._search,
            "correct_the_pose": lambda: self._found(self.eyes.look_near(self.yard, self.spots, self.about)),
        }
        if (said := camera_answer(self.eyes.seeing, action)) or action in acts:
            return said or acts[action]()
        if action in self.model.tests:
            return self.model.tests[action].otherwise
        if action == "go_on_without":
            self.spots.pop(self.about, None)
        return CURED

    def _look_again(self) -> str:
        looked = self.eyes.look(self.yard, self.spots, self.about)
        if not isinstance(looked.sightings[self.about], Located):
            return "nowhere"
        return "elsewhere" if self._has_moved(looked, self.about) else "there"

    def _look_along(self) -> str:
        """Whether another part that has not been moved yet was pushed aside."""
        others = [name for name, spot in self.spots.items() if spot is Spot.FOUND and name != self.about]
        looked = self.eyes.look(self.yard, self.spots, *others)
        seen = (name for name in others if isinstance(looked.sightings[name], Located))
        return "pushed_aside" if any(self._has_moved(looked, each) for each in seen) else "as_before"

    def _look_near(self) -> str:
        looked = self.eyes.look_near(self.yard, self.spots, self.about)
        sighting, before = looked.sightings[self.about], self.seen[self.about]
        if not isinstance(sighting, Located):
            return "nothing"
        if self._has_moved(looked, self.about):
            return "elsewhere"
        surer = isinstance(before, Located) and np.trace(sighting.covariance) < np.trace(before.covariance)
        return "corrected" if surer else "as_before"

    def _look_at_goal(self) -> str:
        if self.held is not None:  # what is seen there is the part itself, in the hand
            return "free"
        return "occupied" if self.eyes.goal_is_taken(self.yard, self.spots, self.about) else "free"

    def _close(self) -> str:
        width = self.shop.close()
        self.shop.open_wide()
        return "closed" if width < CLOSED_M else "wrong"

    def _has_moved(self, looked: Looked, part: str) -> bool:
        sighting = looked.sightings[part]
        assert isinstance(sighting, Located)
        before = self.yard.site.found[part]
        apart = [difference(before, looked.T_world_camera @ each) for each in sighting.equivalent]
        return not any(metres < STILL_M and radians < STILL_RAD for metres, radians in apart)

    def _found(self, looked: Looked) -> str:
        """Believe what was seen of the part from now on; whether it was found."""
        if not isinstance(looked.sightings[self.about], Located):
            return NOT_CURED
        self._believe(looked)
        self.spots[self.about] = Spot.FOUND
        return CURED

    def _search(self) -> str:
        """Search for the hole with the part that is still held, wider than before."""
        if self.held is None or searched_on(self.shop, self.about, self.held) is not Went.DONE:
            return NOT_CURED
        self.spots[self.about], self.held = Spot.GOAL, None
        return CURED

    def _find(self) -> str:
        """Look for the part anew; where it is seen where it was believed, nothing has been put right."""
        looked = self.eyes.look(self.yard, self.spots, self.about)
        if isinstance(looked.sightings[self.about], Located) and not self._has_moved(looked, self.about):
            return NOT_CURED
        return self._found(looked)

    def _see_all(self) -> str:
        """An image is taken, and all parts that have not been moved yet are believed where it shows them."""
        parts = [name for name, spot in self.spots.items() if spot is Spot.FOUND]
        looked = self.eyes.look(self.yard, self.spots, *parts)
        self._believe(looked)
        return f"map({self.eyes.seeing.looks}, {round(1000 * float((looked.image.depth > 0).mean()))})"

    def _believe(self, looked: Looked) -> None:
        """Believe what was seen of parts; those that are not found are believed where they were."""
        old, found, world = self.yard.site, dict(self.yard.site.found), self.yard.site.world
        for part, sighting in looked.sightings.items():
            if isinstance(sighting, Located):
                T = found[part] = likeliest(sighting, looked.T_world_camera, self.yard.goals[part])
                world = world.put(part, "world", T)
                self.seen[part] = sighting
        site = Site(self.eyes.seeing.scene, world, self.eyes.wide(looked, old.looked), found)
        asides = {name: at for name, at in self.yard.asides.items() if name not in looked.sightings}
        self.yard = replace(self.yard, site=site, asides=asides)
        self.known.clear()


def _instance(text: str) -> Function:
    found = ground_term(text)
    assert isinstance(found, Function)
    return found

"""The arm of a workshop shows the target to the camera: the hand really holds it, and it moves on ways that touch nothing."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.placing.carrying import gross
from cellwright.engine.pipelines.placing.holding import HAND, Reach, with_hand
from cellwright.engine.pipelines.placing.showing import HOLD, held_target, target_holds
from cellwright.engine.pipelines.workshop.shop import Workshop
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.scene import Scene

PAUSE_S = 0.3


@dataclass(frozen=True, eq=False)
class Showing:
    """What the arm of a shop does with the target of a scene. Somebody clamps it in the hand, and takes it away in the end.

    Friction alone would let it creep while it is shown, by some millimetres in a minute."""

    shop: Workshop

    def __call__(self, scene: Scene, joints: Sequence[Floats]) -> Iterator[tuple[Floats, World]]:
        """For each of some joint values (k,) that the arm gets to: what its joints read, and the world then.

        Ways are planned in what is believed: other parts may be where nobody knows.
        """
        shop, target, home = self.shop, scene.target, self.shop.q
        holds = target_holds(scene, target)
        believed = held_target(scene, target, shop.world())
        own = frozenset(frozenset((target, each)) for each in (HAND,))
        reach = Reach(believed, shop.arm, own)
        lay = shop.pose(target)
        fastened = False
        for q in joints:
            if not self._go(reach, q):
                continue
            if not fastened:
                self._take_up(scene)
                fastened = True
            yield self._as_it_is(scene, holds.grasps[holds.grasp_of[HOLD]].opening)
        self._go(reach, home)
        if fastened:
            shop.clamp(target, False)
            shop.open_wide()
            shop.stage.put(target, World.of(shop.stage.world.cell).put(target, "world", lay))
        shop.permit()
        shop.wait(PAUSE_S)

    def _take_up(self, scene: Scene) -> None:
        """The target comes between the fingers, and is clamped there."""
        shop, holds = self.shop, target_holds(scene, scene.target)
        shop.open_for(holds.grasps[holds.grasp_of[HOLD]].opening)
        shop.stage.put(scene.target, held_target(scene, scene.target, shop.stage.actual(shop.stage.world)))
        shop.close()
        shop.clamp(scene.target, True)
        shop.wait(PAUSE_S)

    def _go(self, reach: Reach, goal: Floats) -> bool:
        """Whether the arm gets to some joint values (k,)."""
        shop, world = self.shop, reach.world
        now, there = (world.moved(shop.arm, each).configuration for each in (shop.q, goal))
        found = gross(reach, now, there)
        if found is None:
            return False
        first = world.first_carriers[shop.arm]
        shop.permit(shop.scene.target)
        shop.follow(found.path[:, first : first + len(goal)], carries=True)
        return True

    def _as_it_is(self, scene: Scene, opening: Sequence[float]) -> tuple[Floats, World]:
        """What the joints read, and the bodies as they are, the hand among them."""
        shop = self.shop
        q = shop.stage.actual(shop.stage.world).configurations[shop.arm]
        there = shop.world().moved(shop.arm, q)
        return q, with_hand(there, scene, target_holds(scene, scene.target).jaws, opening)

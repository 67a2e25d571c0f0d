"""Tools that an arm takes up and puts down: a latch holds each, in the hand or in the rack, once it is near enough."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.witness.model import quaternion
from cellwright.engine.pipelines.witness.tree import holder_of
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.model import World

SEATED_M, SEATED_RAD = 0.01, 0.05  # how far off a tool may be that a latch still takes


@dataclass(eq=False)
class Latches:
    """The latches of a stage. A tool that sticks stays where it hangs, whatever the hand does."""

    model: Any
    data: Any
    _stuck: set[str] = field(default_factory=set)

    def hang(self, tool: str, world: World) -> None:
        """A tool hangs where a world has it, at once."""
        joint, T = self.data.joint(tool), world.pose("world", tool)
        joint.qpos[:3], joint.qpos[3:], joint.qvel[:] = T[:3, 3], quaternion(T[:3, :3]), 0.0
        self._close(tool, world)

    def exchange(self, tool: str, before: World, after: World) -> None:
        """The latch that holds a tool before a step opens; that of the world after it closes, if the tool is in it."""
        if tool in self._stuck or holder_of(before, tool) == holder_of(after, tool):
            return
        if self._is_seated(tool, after):
            self._close(tool, after)
        else:
            self.data.eq_active[self._number(tool)] = 0
            self.model.body_gravcomp[self.model.body(tool).id] = 0.0

    def stick(self, tool: str, on: bool) -> None:
        """Whether a tool sticks where it hangs."""
        (self._stuck.add if on else self._stuck.discard)(tool)

    def _number(self, tool: str) -> int:
        return int(self.model.equality(f"latch/{tool}").id)

    def _close(self, tool: str, world: World) -> None:
        holder, number = holder_of(world, tool), self._number(tool)
        T = world.pose(tool, holder)
        self.model.eq_obj2id[number] = self.model.body(holder).id
        self.model.eq_data[number, 3:6], self.model.eq_data[number, 6:10] = T[:3, 3], quaternion(T[:3, :3])
        self.data.eq_active[number] = 1
        # The controller is told the load of the tool in the hand.
        self.model.body_gravcomp[self.model.body(tool).id] = float(holder.endswith(".flange"))

    def _is_seated(self, tool: str, world: World) -> bool:
        """Whether a tool is, beside what holds it in a world, where that world has it."""
        holder = holder_of(world, tool)
        T_holder_tool = transforms.inverse(self._pose(holder)) @ self._pose(tool)
        off = transforms.inverse(world.pose(holder, tool)) @ T_holder_tool
        turned = float(np.linalg.norm(transforms.rotation_vector(off[:3, :3])))
        return float(np.linalg.norm(off[:3, 3])) <= SEATED_M and turned <= SEATED_RAD

    def _pose(self, body: str) -> Floats:
        known = self.data.body(body)
        return transforms.transform(known.xmat.reshape(3, 3).copy(), known.xpos.copy())

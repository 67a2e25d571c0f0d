"""An arm that is stopped by what nobody knows of: it goes back by the way it came, to where it was before the step."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellwright.engine.model.moves import Leg, LegKind
from cellwright.engine.pipelines.witness.stage import SETTLE_S, Stage
from cellwright.engine.pipelines.witness.touches import Stopped
from cellwright.engine.stages.geometry.world.model import World

SLOWER = 2.0  # times as long as on the way there


def retreat(stage: Stage, legs: Sequence[Leg], stopped: Stopped, before: World, after: World) -> None:
    """Go back from where a step was stopped, on one of its legs; what was taken at the place is left there, and the other way round."""
    guard, stage.guard = stage.guard, frozenset()
    done = next(n for n, leg in enumerate(legs) if leg is stopped.leg)
    stage.follow(backwards(stopped.leg, stopped.at_s))
    for leg in reversed(legs[:done]):
        if leg.kind is LegKind.IN:
            for tool in stage.tools:
                stage.latches.exchange(tool, after, before)
            stage.fingers(leg.arm, before, closed=False)
            stage.wait(SETTLE_S)
        stage.follow(backwards(leg, leg.seconds))
    stage.guard = guard


def backwards(leg: Leg, at_s: float) -> Leg:
    """The way back to the beginning of a leg from where it is at a time, slower."""
    passed = leg.corners_s < at_s
    path = np.concatenate([leg.at(at_s)[None], leg.path[passed][::-1]])
    corners = SLOWER * np.concatenate([[0.0], at_s - leg.corners_s[passed][::-1]])
    beside = tuple(backwards(each, at_s) for each in leg.beside)
    return replace(leg, path=path, corners_s=corners, beside=beside)

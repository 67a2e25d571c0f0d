"""A proof that there is no path is told with its joints and what they cannot pass."""

from types import SimpleNamespace
from typing import cast

import numpy as np

from cellwright.engine.formats.report.cells.motion_pictures import _drawn_configurations
from cellwright.engine.formats.report.cells.motion_report import content_of, no_motion_text
from cellwright.engine.model.geometry import Contact
from cellwright.engine.model.motion_values import Blocked, Severed
from cellwright.engine.pipelines.motion.arm_motion import ArmMotion

CONTACT = Contact("link 1", "post", -0.04, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0]))


def test_what_cannot_pass_what_is_said_and_written() -> None:
    proof = Severed((0,), 2048, np.zeros(2), (CONTACT,))
    answer = Blocked(np.zeros((2, 2)), 1.0, 10, (1, 1), np.zeros(2), (), severed=proof)
    said = no_motion_text(answer, ["base", "elbow"], [False, False])
    assert "there is none, that is proved: whatever base does, link 1 cannot pass post" in said
    written = content_of(answer, ["base", "elbow"])["severed"]
    assert written["joints"] == ["base"]
    assert written["contacts"][0]["between"] == ["link 1", "post"]


def test_a_picture_shows_the_start_and_what_cuts_the_goal_off() -> None:
    start, at = np.array([0.0, 1.0]), np.array([0.9, 1.0])
    proof = Severed((0,), 2048, at, (CONTACT,))
    answer = Blocked(np.zeros((2, 2)), 1.0, 10, (1, 1), np.zeros(2), (), severed=proof)
    motion = cast("ArmMotion", SimpleNamespace(answer=answer, start=start))
    drawn, contacts = _drawn_configurations(motion)
    assert np.array_equal(drawn, [start, at])
    assert contacts == (CONTACT,)

"""Whole turns: a joint that turns has the same pose again after each, as far as its limits allow."""

import math
from itertools import product

import numpy as np

from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.stages.geometry.kinematics.arms import ArmModel


def turns(model: ArmModel, q: Floats) -> Floats:
    """Every configuration within the joint limits that differs from q (k,) by whole turns alone (m, k)."""
    choices = []
    for index, value in enumerate(q):
        shifts = [0.0] if model.joints.prismatic[index] else [-2 * np.pi, 0.0, 2 * np.pi]
        inside = [value + s for s in shifts if model.within_limits_of(index, value + s)]
        choices.append(inside)
    return np.array(list(product(*choices))).reshape(-1, len(q))


def nearest_turns(model: ArmModel, q: Floats, now: Floats) -> Floats:
    """Configurations (m, k) within the limits: those of `q` (n, k), turned by whole turns to be nearest to `now` (k,).

    Those that no turn brings within the limits are left out.
    """
    found, inside = turned_near(model, q, now)
    near: Floats = found[inside]
    return near


def turned_near(model: ArmModel, q: Floats, now: Floats) -> tuple[Floats, Truths]:
    """Configurations (..., k), turned by whole turns to be nearest to `now` within the limits, and which can be within them."""
    joints, turn = model.joints, 2 * math.pi
    whole = np.round((now - q) / turn)
    best, least = np.array(q), np.full(q.shape, np.inf)
    for more in (0.0, -1.0, 1.0, -2.0, 2.0):
        values = q + np.where(joints.prismatic, 0.0, (whole + more) * turn)
        within = (values >= joints.lower - 1e-9) & (values <= joints.upper + 1e-9)
        far = np.where(within, np.abs(values - now), np.inf)
        nearer = far < least
        best[nearer], least[nearer] = values[nearer], far[nearer]
    return best, np.isfinite(least).all(axis=-1)

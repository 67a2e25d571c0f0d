"""A troubleshooting problem as the arrays that the compiled searches read."""

import numpy as np

from engine.kernels.arrays import Floats, Longs, Truths
from engine.model.troubleshooting import Action, Setup, Troubleshooting, field_bits, situation_bits
from engine.stages.diagnosis.kernels.belief import Beliefs
from engine.stages.diagnosis.kernels.partition import Partition


def beliefs(problem: Troubleshooting) -> Beliefs:
    """The problem for the searches that keep a weight for each cause."""
    outcomes = max((len(action.outcomes) for action in problem.actions), default=1)
    causes, actions = len(problem.causes), problem.actions
    likelihoods = np.zeros((len(actions), outcomes, causes))
    ends = np.zeros((len(actions), outcomes), dtype=np.bool_)
    for index, action in enumerate(actions):
        likelihoods[index, : len(action.outcomes)] = action.likelihoods
        ends[index, list(action.ends)] = True
    masks = (likelihoods > 0.0) @ (1 << np.arange(causes, dtype=np.int64))
    repairs: Truths = np.logical_or.reduce(ends, axis=1)
    costs, following = _setup(actions, problem.setup)
    losses = np.array([each.losses for each in problem.conclusions], np.float64).reshape(-1, causes)
    widths = np.array([field_bits(action) for action in actions], dtype=np.int64)
    base = situation_bits(problem.setup)
    shifts = base + np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(widths)[:-1]])[: len(actions)]
    known = _known(losses, likelihoods, ends, costs.min(axis=0))
    return Beliefs(
        likelihoods,
        masks,
        ends,
        repairs,
        costs,
        following,
        losses,
        known,
        shifts.astype(np.int64),
        widths,
        base,
    )


def partition(problem: Troubleshooting) -> Partition | None:
    """The problem for the search over sets of causes; None if outcomes are uncertain or conclusions have
    losses.
    """
    arrays = beliefs(problem)
    if (
        not all(action.certain for action in problem.actions)
        or not np.isin(arrays.losses, (0.0, np.inf)).all()
    ):
        return None
    goals = _goals(problem, arrays.losses)
    together = [int(goal) for goal in goals] + [int(mask) for mask in arrays.masks[arrays.ends]]
    return Partition(
        _masses(problem.priors),
        arrays.masks,
        arrays.ends,
        arrays.costs,
        arrays.following,
        arrays.costs.min(axis=0),
        goals,
        np.array(_merged(together), dtype=np.int64),
        arrays.known,
    )


def groups(problem: Troubleshooting) -> Longs:
    """For each cause (C,) the number of its group. Causes that may be concluded together are in one group."""
    found = np.arange(len(problem.causes), dtype=np.int64)
    losses = np.array([each.losses for each in problem.conclusions], np.float64).reshape(-1, len(found))
    for group in _merged([int(goal) for goal in _goals(problem, losses)]):
        members = (group >> np.arange(len(found), dtype=np.int64)) & 1 == 1
        found[members] = found[members].min()
    return found


def _goals(problem: Troubleshooting, losses: Floats) -> Longs:
    """For each conclusion whose losses are all 0 or infinite, the set of causes under which it loses nothing."""
    barred = np.isin(losses, (0.0, np.inf)).all(axis=1) if len(losses) else np.zeros(0, dtype=np.bool_)
    powers = 1 << np.arange(len(problem.causes), dtype=np.int64)
    return np.asarray((losses[barred] == 0.0) @ powers, dtype=np.int64)


def priors(problem: Troubleshooting) -> Floats:
    """The weights at the start."""
    return np.array(problem.priors, np.float64)


def _setup(actions: tuple[Action, ...], setup: Setup | None) -> tuple[Floats, Longs]:
    """Costs with set-up, and the situations after the actions; both (situations, actions)."""
    own = np.array([[action.cost for action in actions]], np.float64)
    if setup is None:
        return own, np.zeros(own.shape, dtype=np.int64)
    shape = (len(setup.costs), len(actions))
    return own + np.array(setup.costs).reshape(shape), np.array(setup.following, dtype=np.int64).reshape(
        shape
    )


def _known(losses: Floats, likelihoods: Floats, ends: Truths, costs: Floats) -> Floats:
    """For each cause, a lower bound on the cost of ending the case if the cause were known.

    A conclusion costs its loss. A repair that costs c ends the case with probability p. However repairs are
    combined, curing the cause costs at least the best c / p.
    """
    chances = (likelihoods * ends[:, :, None]).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = np.where(chances > 0.0, costs[:, None] / chances, np.inf)
    least: Floats = np.concatenate([losses, rates]).min(axis=0, initial=np.inf)
    return least


def _masses(weights: tuple[float, ...]) -> Floats:
    """The probability of each set of causes within each byte of the word (8, 256)."""
    padded = np.zeros(64)
    padded[: len(weights)] = weights
    bits = (np.arange(256)[:, None] >> np.arange(8)) & 1
    return np.ascontiguousarray((bits @ padded.reshape(8, 8).T).T)


def _merged(sets: list[int]) -> list[int]:
    """The sets, with those that overlap united, so that the result is disjoint.

    Sets of one cause are dropped.
    """
    merged: list[int] = []
    for each in sets:
        apart = [other for other in merged if not other & each]
        for other in merged:
            each |= other if other & each else 0
        merged = [*apart, each]
    return sorted(each for each in merged if each & (each - 1))

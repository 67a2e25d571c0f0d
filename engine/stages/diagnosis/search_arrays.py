"""A troubleshooting problem as the arrays that the compiled searches read."""

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths, Words
from cellwright.engine.model.troubleshooting import (
    Action,
    Setup,
    Troubleshooting,
    field_bits,
    situation_bits,
)
from cellwright.engine.stages.diagnosis.kernels.belief import Beliefs
from cellwright.engine.stages.diagnosis.kernels.partition import Partition
from cellwright.engine.stages.diagnosis.kernels.rollout import Groups


def belief_arrays(problem: Troubleshooting) -> Beliefs:
    """The problem for the searches that keep a weight for each cause."""
    outcomes = max((len(action.outcomes) for action in problem.actions), default=1)
    causes, actions = len(problem.causes), problem.actions
    likelihoods = np.zeros((len(actions), outcomes, causes))
    ends = np.zeros((len(actions), outcomes), dtype=np.bool_)
    for index, action in enumerate(actions):
        likelihoods[index, : len(action.outcomes)] = action.likelihoods
        ends[index, list(action.ends)] = True
    repairs: Truths = np.logical_or.reduce(ends, axis=1)
    costs, following = _setup_arrays(actions, problem.setup)
    losses = _loss_matrix(problem)
    widths = np.array([field_bits(action) for action in actions], dtype=np.int64)
    base = situation_bits(problem.setup)
    known = _costs_if_known(losses, likelihoods, ends, costs.min(axis=0))
    return Beliefs(
        likelihoods,
        ends,
        repairs,
        _certain_outcomes(likelihoods, widths),
        costs,
        following,
        losses,
        known,
        _key_shifts(widths, base),
        widths,
        base,
        1.0 - problem.certainty,
        np.array(
            [-1 if action.repeats is None else action.repeats for action in actions], dtype=np.int64
        ),
    )


def _loss_matrix(problem: Troubleshooting) -> Floats:
    return np.array([conclusion.losses for conclusion in problem.conclusions], np.float64).reshape(
        -1, len(problem.causes)
    )


def _certain_outcomes(likelihoods: Floats, widths: Longs) -> Longs:
    """For each action and cause (A, C) the outcome; -1 for every cause if the outcomes are
    uncertain.
    """
    shown: Longs = likelihoods.argmax(axis=1).astype(np.int64)
    shown[widths > 0] = -1
    return shown


def _key_shifts(widths: Longs, first: int) -> Longs:
    """Where the outcomes of the actions stand in a key. None goes beyond the end of a word."""
    shifts, at = np.zeros(len(widths), np.int64), first
    for action, width in enumerate(widths.tolist()):
        if at % 64 + width > 64:
            at += 64 - at % 64
        shifts[action] = at
        at += width
    return shifts


def rest_after(problem: Beliefs, action: int, outcome: int, rest: int) -> int:
    """The rest of the key after an outcome of an action.

    Outcomes of repetitions are kept in descending order.
    """
    situation = situation_in_key(problem, rest)
    after = rest ^ situation ^ int(problem.following[situation, action])
    if not problem.widths[action]:
        return after
    digit = outcome + 1
    while (earlier := int(problem.before[action])) >= 0 and (
        seen := digit_in(problem, earlier, after)
    ) < digit:
        after ^= seen << int(problem.shifts[earlier])
        after |= seen << int(problem.shifts[action])
        action = earlier
    return after | digit << int(problem.shifts[action])


def digit_in(problem: Beliefs, action: int, rest: int) -> int:
    """The outcome of an action plus one in the rest of a key; 0 if there is none."""
    return (rest >> int(problem.shifts[action])) & ((1 << int(problem.widths[action])) - 1)


def situation_in_key(problem: Beliefs, rest: int) -> int:
    """The situation in the rest of a key."""
    return rest & ((1 << problem.situations) - 1)


def cause_set_arrays(problem: Troubleshooting, arrays: Beliefs) -> Partition | None:
    """The problem for the search over sets of causes; None if outcomes are uncertain or conclusions
    have losses.
    """
    if arrays.widths.any() or arrays.slack > 0.0 or not np.isin(arrays.losses, (0.0, np.inf)).all():
        return None
    goals = arrays.losses == 0.0
    together = np.concatenate([goals, arrays.likelihoods[arrays.ends] > 0.0])
    exempt = np.array(_merge_sets(together), dtype=np.bool_).reshape(-1, len(problem.causes))
    return Partition(
        _byte_masses(problem.priors),
        _set_words(arrays.likelihoods > 0.0),
        arrays.ends,
        arrays.costs,
        arrays.following,
        arrays.costs.min(axis=0),
        _set_words(goals),
        _set_words(exempt),
        arrays.known,
    )


def cause_groups(arrays: Beliefs) -> Groups:
    """The groups of causes that may be concluded together, and what the policies of a rollout
    cost at most.
    """
    losses = arrays.losses
    worst = float(losses[np.isfinite(losses)].max(initial=0.0))
    return Groups(arrays, _first_of_group(losses), arrays.costs.max(axis=0), worst)


def _first_of_group(losses: Floats) -> Longs:
    """For each cause (C,) the first cause with which it hangs together by conclusions that join
    causes without loss.
    """
    first_causes = np.arange(losses.shape[1], dtype=np.int64)
    barred = np.isin(losses, (0.0, np.inf)).all(axis=1)
    for group in _merge_sets(losses[barred] == 0.0):
        first_causes[group] = first_causes[group].min()
    return first_causes


def prior_weights(problem: Troubleshooting) -> Floats:
    """The weights at the start."""
    return np.array(problem.priors, np.float64)


def _setup_arrays(actions: tuple[Action, ...], setup: Setup | None) -> tuple[Floats, Longs]:
    """Costs with set-up, and the situations after the actions; both (situations, actions)."""
    own = np.array([[action.cost for action in actions]], np.float64)
    if setup is None:
        return own, np.zeros(own.shape, dtype=np.int64)
    shape = (len(setup.costs), len(actions))
    return own + np.array(setup.costs).reshape(shape), np.array(
        setup.following, dtype=np.int64
    ).reshape(shape)


def _costs_if_known(losses: Floats, likelihoods: Floats, ends: Truths, costs: Floats) -> Floats:
    """For each cause, a lower bound on the cost of ending the case if the cause were known.

    A conclusion costs its loss. A repair that costs c ends the case with probability p, and helps
    no more if it is repeated. So repairs are tried in the order of c / p, as far as that is cheaper
    than the conclusion.
    """
    chances = (likelihoods * ends[:, :, None]).sum(axis=1)
    least: Floats = losses.min(axis=0, initial=np.inf)
    for cause in range(len(least)):
        cures = [(costs[a], p) for a, p in enumerate(chances[:, cause].tolist()) if p > 0.0]
        for cost, chance in sorted(cures, key=lambda each: each[0] / each[1], reverse=True):
            after = (1.0 - chance) * least[cause] if chance < 1.0 else 0.0
            least[cause] = min(least[cause], cost + after)
        if not np.isfinite(least[cause]) and cures:
            least[cause] = min(cost / chance for cost, chance in cures)
    return least


def _set_words(sets: Truths) -> Words:
    """The sets (..., C) in words of 64 bits (..., W)."""
    count = (sets.shape[-1] + 63) // 64
    padded = np.zeros((*sets.shape[:-1], 64 * count), dtype=np.bool_)
    padded[..., : sets.shape[-1]] = sets
    packed = np.packbits(padded, axis=-1, bitorder="little")
    return (
        np.ascontiguousarray(packed).view("<u8").astype(np.uint64).reshape(*sets.shape[:-1], count)
    )


def _byte_masses(weights: tuple[float, ...]) -> Floats:
    """The probability of each set of causes within each byte of the words (8 W, 256)."""
    padded = np.zeros((len(weights) + 63) // 64 * 64)
    padded[: len(weights)] = weights
    bits = (np.arange(256)[:, None] >> np.arange(8)) & 1
    return np.ascontiguousarray((bits @ padded.reshape(-1, 8).T).T)


def _merge_sets(sets: Truths) -> list[Truths]:
    """The sets (n, C), with those that overlap united, so that the result is disjoint.

    Sets of one cause are dropped.
    """
    merged: list[Truths] = []
    for overlapping in sets[sets.sum(axis=1) > 1]:
        apart = [group for group in merged if not (group & overlapping).any()]
        for group in merged:
            overlapping = overlapping | group if (group & overlapping).any() else overlapping
        merged = [*apart, overlapping]
    return merged

"""A shape fitted to measured points: by consensus, then by least squares over the points that belong to it.

Least squares weigh each point by its standard deviation square to the shape. The covariance is that of the linearised
problem; it holds as far as the standard deviations of the points do.
"""

from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.rigid import apply, inverse, transform, turned
from cellwright.engine.model.fits import PARAMETERS, Cloud, Fit, Fitting, Shape, Unfitted, unusable
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.stages.fitting.beams import narrowed
from cellwright.engine.stages.fitting.distances import distances, normals, slopes
from cellwright.engine.stages.fitting.rays import GRAZING, met
from cellwright.engine.stages.fitting.starts import SAMPLE, Guess, guesses

BELONGS = 3.5  # standard deviations: a point farther off does not belong to the shape
USUAL = 4.0  # times the median: until a shape has settled, a point farther off does not belong to it
STARTS, ROUNDS, STEPS = 4, 12, 25  # guesses that are refined, choices of points, steps for each choice
ENOUGH = 400  # points that guesses are compared over
SEED = 20261123
SHORTER = (1.0, 0.5, 0.25, 0.1, 0.02)  # parts of a step that are tried, until one is no worse
PASSES = 2  # of taking out what a wide beam does: the first begins from a shape that it has moved
SHARE = 0.5  # of the points that must belong
VAGUE = 0.05  # rad, or of a radius: with larger standard deviations, shapes are no longer linear in their parameters
STILL = 1e-3  # standard deviations: a step that moves the shape by less is the last
LOOSE = 1e-9  # how much smaller than the best known direction of its parameters a shape's worst may be


def fitted(shape: Shape, cloud: Cloud, near: Fit | None = None) -> Fitting:
    """The shape to which most of the points belong, or why there is none. It is looked for beside the one that it is `near` to, if one is given."""
    if (reason := _senseless(shape, cloud)) is not None:
        return Unfitted(reason)
    every = np.ones(len(cloud.points), bool)
    best = _best(shape, cloud) if near is None else _settled(shape, cloud, every, _guess(near))
    if best is None:
        return Unfitted(f"no {shape} goes through the points")
    for _ in range(PASSES if cloud.beam_m is not None else 0):
        at = _guess(best)
        best = _settled(shape, *narrowed(shape, cloud, at), at) or best
    share = float(best.used.mean())
    if share < SHARE:
        return Unfitted(f"only {share:.0%} of the points lie on one {shape}")
    vague = _vague(best)
    return Unfitted(f"the points show too little of the {shape}: {vague}") if vague else best


def _best(shape: Shape, cloud: Cloud) -> Fit | None:
    """The shape that most points belong to, of those that guesses lead to; None if they lead to none.

    Where there are many points, the guesses are compared over some of them, and only the best one goes on with all.
    """
    every = np.ones(len(cloud.points), bool)
    some = every.copy()
    if len(cloud.points) > ENOUGH:
        some[:] = False
        some[np.random.default_rng(SEED).choice(len(cloud.points), ENOUGH, replace=False)] = True
    part = _some(cloud, some)
    found = [_settled(shape, part, some[some], each) for each in guesses(shape, part, STARTS)]
    kept = sorted((each for each in found if each is not None), key=lambda e: (-int(e.used.sum()), e.chi2))
    if some.all():
        return kept[0] if kept else None
    led = (_settled(shape, cloud, every, _guess(each)) for each in kept)
    return next((each for each in led if each is not None), None)


def _guess(fit: Fit) -> Guess:
    return Guess(fit.T_world_shape, np.asarray(fit.radius_m), np.asarray(fit.angle_rad))


def _vague(fit: Fit) -> str:
    """What is known so badly that its standard deviation means nothing; empty if all is well."""
    if fit.shape is Shape.CONE and (angle := fit.deviation("angle")) > VAGUE:
        return f"its angle is known to {np.degrees(angle):.1f} degrees only"
    if fit.shape is not Shape.PLANE and (radius := fit.deviation("radius")) > VAGUE * fit.radius_m:
        return f"its radius is known to {1e3 * radius:.3g} mm only"
    if fit.shape is not Shape.SPHERE and (tilt := _tilt_rad(fit)) > VAGUE:
        return f"its direction is known to {np.degrees(tilt):.1f} degrees only"
    return ""


def _tilt_rad(fit: Fit) -> float:
    """The standard deviation of the tilt towards the least known side."""
    tilts = [PARAMETERS[fit.shape].index(each) for each in ("tilt_x", "tilt_y")]
    return float(np.sqrt(np.linalg.eigvalsh(fit.covariance[np.ix_(tilts, tilts)])[-1]))


def _senseless(shape: Shape, cloud: Cloud) -> str | None:
    least = max(SAMPLE[shape], len(PARAMETERS[shape]) + 1)
    if len(cloud.points) < least:
        return f"a {shape} needs at least {least} points, there are {len(cloud.points)}"
    return unusable(cloud.points, cloud.sigma_m)


@dataclass(frozen=True, slots=True, eq=False)
class _Local:
    """Points in the frame of a shape: distances and slopes by standard deviations, a row for each number; and these in metres."""

    off: Floats
    by: Floats
    sigma: Floats


def _settled(shape: Shape, cloud: Cloud, among: Truths, guess: Guess) -> Fit | None:
    """The shape after the points that belong to it, among some, have settled; None if they do not, or leave it loose."""
    at, used, limit = guess, np.zeros(len(cloud.points), bool), np.inf
    for _ in range(ROUNDS):
        off = _worst(_local(shape, cloud, at), shape)
        limit = max(BELONGS, min(limit / 2, USUAL * float(np.median(off))))
        now = among & (off <= limit)
        if limit == BELONGS and (now == used).all():
            return _finished(shape, cloud, at, used)
        if now.sum() <= len(PARAMETERS[shape]):
            return None
        used, moved = now, _least_squares(shape, cloud, at, now)
        if moved is None:
            return None
        at = moved
    return _finished(shape, cloud, at, used)


def _worst(local: _Local, shape: Shape) -> Floats:
    """How far each point is off (n,), by its standard deviations."""
    rows = 2 if shape is Shape.CIRCLE else 1
    found: Floats = np.abs(local.off).reshape(-1, rows).max(axis=1)
    return found


def _local(shape: Shape, cloud: Cloud, at: Guess, sigma: Floats | None = None) -> _Local:
    """The points in the frame of a shape; `sigma` (rows,), if given, stands for the standard deviations that follow from the shape."""
    points = apply(inverse(at.T), cloud.points)
    radius, angle = float(at.radius_m), float(at.angle_rad)
    if cloud.directions is not None and shape is not Shape.CIRCLE:
        off, by, own = _along(shape, cloud, at, points)
    else:
        off = distances(shape, points, np.asarray(at.radius_m), np.asarray(at.angle_rad)).ravel()
        by = slopes(shape, points, radius, angle).reshape(len(off), -1)
        own = _square_to(shape, cloud, at, points).ravel()
    sigma = own if sigma is None else sigma
    return _Local(off / sigma, by / sigma[:, None], sigma)


def _square_to(shape: Shape, cloud: Cloud, at: Guess, points: Floats) -> Floats:
    """The standard deviations (n, rows) square to a shape."""
    rows = 2 if shape is Shape.CIRCLE else 1
    sigma: Floats = np.broadcast_to(cloud.sigma_m[:, None], (len(points), rows))
    if cloud.directions is None:
        return sigma
    beams = cloud.directions @ at.T[:3, :3]
    facing = np.abs((normals(shape, points, float(at.angle_rad)) * beams[:, None]).sum(axis=-1))
    found: Floats = sigma * np.maximum(facing, GRAZING)
    return found


def _along(shape: Shape, cloud: Cloud, at: Guess, points: Floats) -> tuple[Floats, Floats, Floats]:
    """By how much each range is too long (n,), how that changes with the shape (n, p), and its standard deviation (n,)."""
    assert cloud.directions is not None
    radius, angle = float(at.radius_m), float(at.angle_rad)
    there = met(shape, points, cloud.directions @ at.T[:3, :3], radius, angle)
    sigma = cloud.sigma_m
    if cloud.pointing_m is not None:
        tangent = np.sqrt(np.maximum(1.0 - there.facing**2, 0.0)) / np.abs(there.facing)
        sigma = np.hypot(sigma, cloud.pointing_m * tangent)
    return there.behind_m, slopes(shape, there.feet, radius, angle)[:, 0] / there.facing[:, None], sigma


def _least_squares(shape: Shape, cloud: Cloud, at: Guess, used: Truths) -> Guess | None:
    """The nearest shape with the least squares over the used points: steps of Gauss and Newton, halved where they overshoot.

    The weights stay those of the first shape. If they followed each step, the least sum would be at a shape that makes the deviations look
    large, not at the one that the points lie on.
    """
    some = _some(cloud, used)
    at = _centred(shape, some, at)
    local = _local(shape, some, at)
    cost = float(local.off @ local.off)
    for _ in range(STEPS):
        step, *_ = np.linalg.lstsq(local.by, -local.off, rcond=LOOSE)
        if not np.isfinite(step).all():
            return None
        for part in SHORTER:
            moved = _centred(shape, some, _moved(shape, at, np.asarray(part * step, float)))
            there = _local(shape, some, moved, local.sigma)
            if (now := float(there.off @ there.off)) <= cost:
                break
        else:
            return at
        gained, at, local, cost = cost - now, moved, there, now
        if gained < STILL**2:
            break
    return at


def _some(cloud: Cloud, used: Truths) -> Cloud:
    beams = (cloud.directions, cloud.beam_m, cloud.pointing_m, cloud.range_m)
    return Cloud(
        cloud.points[used], cloud.sigma_m[used], *(None if each is None else each[used] for each in beams)
    )


def _moved(shape: Shape, at: Guess, step: Floats) -> Guess:
    """The shape after its parameters have changed by a step (p,)."""
    by = dict(zip(PARAMETERS[shape], step.tolist(), strict=True))
    x, y, z, a, b = (by.get(each, 0.0) for each in ("x", "y", "z", "tilt_x", "tilt_y"))
    T = at.T @ transform(turned(np.array([-b, a, 0.0])), (x, y, z))
    radius, angle = at.radius_m + by.get("radius", 0.0), at.angle_rad + by.get("angle", 0.0)
    return Guess(T, np.asarray(radius), np.asarray(angle))


def _centred(shape: Shape, cloud: Cloud, at: Guess) -> Guess:
    """The same shape with its origin amid the points, as far as it may move along the shape."""
    x, y, z = apply(inverse(at.T), cloud.points.mean(axis=0, keepdims=True))[0]
    shift = {Shape.PLANE: (x, y, 0.0), Shape.CYLINDER: (0.0, 0.0, z), Shape.CONE: (0.0, 0.0, z)}.get(shape)
    if shift is None:
        return at
    wider = shift[2] * np.tan(at.angle_rad)
    return replace(at, T=at.T @ transform(np.eye(3), shift), radius_m=np.asarray(at.radius_m + wider))


def _finished(shape: Shape, cloud: Cloud, at: Guess, used: Truths) -> Fit | None:
    """The fit with its covariance; None if the points leave something loose, or if it is turned inside out."""
    at = _widening(at)
    local = _local(shape, _some(cloud, used), at)
    values, vectors = np.linalg.eigh(_scaled(local.by))
    if values[0] <= LOOSE * values[-1] or at.radius_m < 0 or not abs(at.angle_rad) < np.pi / 2:
        return None
    scale = np.sqrt((local.by**2).sum(axis=0))
    covariance = (vectors / values) @ vectors.T / np.outer(scale, scale)
    freedom = len(local.off) - len(PARAMETERS[shape])
    chi2 = float(local.off @ local.off)
    return Fit(shape, at.T, float(at.radius_m), float(at.angle_rad), covariance, used, chi2, freedom)


def _widening(at: Guess) -> Guess:
    """The same shape with its z axis towards where it widens."""
    if at.angle_rad >= 0:
        return at
    return Guess(at.T @ np.diag([1.0, -1.0, -1.0, 1.0]), at.radius_m, -at.angle_rad)


def _scaled(by: Floats) -> Floats:
    """The normal matrix (p, p) of parameters that are scaled to matter alike."""
    scaled = by / np.sqrt((by**2).sum(axis=0))
    found: Floats = scaled.T @ scaled
    return found

"""Shapes fitted to measured points by consensus and least squares, for thin and wide beams.

A beam of some width tells the mean of the ranges that it meets, by the strength of what each part
returns: the cosine of the incidence over the square of the range. A beam that points a little
beside its direction tells, in the mean over many, a range that is off as well, but for the
strength. Both means are taken over seven beams each, by a rule that is exact to the fifth order for
a normal distribution (Abramowitz & Stegun 1964, 25.4.61; Stroud 1971). On a leaning plane they are
off, too, because beams spread.
"""

from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import apply, inverse, rotation_by_vector, transform
from cellwright.engine.model.shape_fits import (
    SHAPE_PARAMETERS,
    Cloud,
    Fit,
    FitShape,
    Fitting,
    Unfitted,
    why_unfittable,
)
from cellwright.engine.stages.fitting.shape_distances import (
    GRAZING_COSINE,
    BeamHits,
    beam_hits,
    distance_normals,
    distance_slopes,
    shape_distances,
)
from cellwright.engine.stages.fitting.shape_guesses import SAMPLE_SIZES, ShapeGuess, guess_shapes

# by this share the cosine of the incidence may change over a beam; with more, the fifth order is
# not enough
MAX_COSINE_CHANGE = 0.05
FAN_ANGLES_RAD = np.pi / 3.0 * np.arange(6)
FAN_NODES = np.concatenate(
    [[[0.0, 0.0]], 2.0 * np.stack([np.cos(FAN_ANGLES_RAD), np.sin(FAN_ANGLES_RAD)], axis=1)]
)
FAN_WEIGHTS = np.array([0.5, *[1.0 / 12.0] * 6])


@dataclass(frozen=True, slots=True, eq=False)
class _BeamFan:
    """What beams (7, n) about each direction meet: ranges beyond the middle one's, strengths by the
    middle one's, and whether all hit (n,).

    `turned` (n,) is by how much, in the mean square, the cosine of the incidence differs from the
    middle one's.
    """

    longer_m: Floats
    strength: Floats
    turned: Floats
    hit: Truths


def narrow_beams(shape: FitShape, cloud: Cloud, at: ShapeGuess) -> tuple[Cloud, Truths]:
    """The cloud as thin beams would have told it, for points on a shape near `at`, and the points
    (n,) for which that is known.

    The cloud is the same without beams, or for the rim of a hole. Which points are known follows
    from the directions of their beams, not from their ranges, so leaving the others out does not
    bias a fit.
    """
    if cloud.directions is None or cloud.beam_m is None or shape is FitShape.CIRCLE:
        return cloud, np.ones(len(cloud.points), bool)
    beams = cloud.directions @ at.T[:3, :3]
    points = apply(inverse(at.T), cloud.points)
    middle = beam_hits(shape, points, beams, float(at.radius_m), float(at.angle_rad))
    own = _fan_of_beams(shape, cloud, at, beams, middle, cloud.beam_m)
    wide_m = cloud.beam_m if cloud.pointing_m is None else np.hypot(cloud.beam_m, cloud.pointing_m)
    wide = (
        own if cloud.pointing_m is None else _fan_of_beams(shape, cloud, at, beams, middle, wide_m)
    )
    share = FAN_WEIGHTS[:, None] * own.strength
    by_strength = (share * own.longer_m).sum(axis=0) / share.sum(
        axis=0
    ) - FAN_WEIGHTS @ own.longer_m
    longer = FAN_WEIGHTS @ wide.longer_m + by_strength
    usable = middle.hit & own.hit & wide.hit & (wide.turned <= MAX_COSINE_CHANGE)
    longer = np.where(usable, longer, 0.0)
    return replace(cloud, points=cloud.points - cloud.directions * longer[:, None]), usable


def _fan_of_beams(
    shape: FitShape, cloud: Cloud, at: ShapeGuess, beams: Floats, middle: BeamHits, wide_m: Floats
) -> _BeamFan:
    """Beams about each direction, whose places across it have a standard deviation of `wide_m`
    (n,) where the shape is met.
    """
    count = len(beams)
    u, v = _vectors_across(beams)
    aside = wide_m[:, None] * (FAN_NODES[:, :1, None] * u + FAN_NODES[:, 1:, None] * v)
    through = middle.feet + aside
    away = np.full(count, np.inf) if cloud.range_m is None else cloud.range_m - middle.behind_m
    rays = beams + aside / away[:, None]
    length = np.sqrt((rays * rays).sum(axis=-1, keepdims=True))
    rays = rays / length
    hits = beam_hits(
        shape, through.reshape(-1, 3), rays.reshape(-1, 3), float(at.radius_m), float(at.angle_rad)
    )
    behind, facing, hit = (
        values.reshape(len(FAN_NODES), count) for values in (hits.behind_m, hits.facing, hits.hit)
    )
    # A beam beside the middle one is longer from the eye to the same plane across.
    spread = 0.0 if cloud.range_m is None else away * (length[..., 0] - 1.0)
    longer = spread - behind
    strength = np.maximum(facing / middle.facing, 0.0) / (1.0 + longer / away) ** 2
    turned = np.sqrt(FAN_WEIGHTS @ (facing / middle.facing - 1.0) ** 2)
    return _BeamFan(np.asarray(longer, float), strength, turned, np.asarray(hit.all(axis=0)))


def _vectors_across(beams: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (n, 3) square to each beam and to each other."""
    helper = np.eye(3)[np.argmin(np.abs(beams), axis=1)]
    u = np.cross(beams, helper)
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(beams, u)


BELONGING_SIGMAS = 3.5  # standard deviations: a point farther off does not belong to the shape
# times the median: until a shape has settled, a point farther off does not belong to it
USUAL_MEDIANS = 4.0
GUESSES_REFINED, MAX_CHOICE_ROUNDS, MAX_FIT_STEPS = (
    4,
    12,
    25,
)  # guesses that are refined, choices of points, steps for each choice
MAX_GUESS_POINTS = 400  # points that guesses are compared over
FIT_SEED = 20261123
STEP_SHARES = (1.0, 0.5, 0.25, 0.1, 0.02)  # parts of a step that are tried, until one is no worse
# of taking out what a wide beam does: the first begins from a shape that it has moved
BEAM_PASSES = 2
MIN_BELONGING_SHARE = 0.5  # of the points that must belong
# rad, or of a radius: with larger standard deviations, shapes are no longer linear in their
# parameters
MAX_RELATIVE_SIGMA = 0.05
LAST_STEP_SIGMAS = 1e-3  # standard deviations: a step that moves the shape by less is the last
LOOSE_PARAMETER = (
    1e-9  # how much smaller than the best known direction of its parameters a shape's worst may be
)


def fit_measured_shape(shape: FitShape, cloud: Cloud, near: Fit | None = None) -> Fitting:
    """The shape to which most of the points belong, or why there is none.

    It is looked for beside the one that it is `near` to, if one is given.
    """
    if (reason := _senseless_cloud(shape, cloud)) is not None:
        return Unfitted(reason)
    every = np.ones(len(cloud.points), bool)
    best = (
        _best_fit(shape, cloud)
        if near is None
        else _settle_shape(shape, cloud, every, _guess_of(near))
    )
    if best is None:
        return Unfitted(f"no {shape} goes through the points")
    for _ in range(BEAM_PASSES if cloud.beam_m is not None else 0):
        at = _guess_of(best)
        best = _settle_shape(shape, *narrow_beams(shape, cloud, at), at) or best
    share = float(best.used.mean())
    if share < MIN_BELONGING_SHARE:
        return Unfitted(f"only {share:.0%} of the points lie on one {shape}")
    vague = _vague_parameter(best)
    return Unfitted(f"the points show too little of the {shape}: {vague}") if vague else best


def _best_fit(shape: FitShape, cloud: Cloud) -> Fit | None:
    """The shape that most points belong to, of those that guesses lead to; None if they lead to
    none.

    Where there are many points, the guesses are compared over some of them, and only the best one
    goes on with all.
    """
    every = np.ones(len(cloud.points), bool)
    some = every.copy()
    if len(cloud.points) > MAX_GUESS_POINTS:
        some[:] = False
        some[
            np.random.default_rng(FIT_SEED).choice(
                len(cloud.points), MAX_GUESS_POINTS, replace=False
            )
        ] = True
    part = _select_points(cloud, some)
    fits = [
        _settle_shape(shape, part, some[some], guess)
        for guess in guess_shapes(shape, part, GUESSES_REFINED)
    ]
    ordered_fits = sorted(
        (fit for fit in fits if fit is not None), key=lambda e: (-int(e.used.sum()), e.chi2)
    )
    if some.all():
        return ordered_fits[0] if ordered_fits else None
    led = (_settle_shape(shape, cloud, every, _guess_of(fit)) for fit in ordered_fits)
    return next((fit for fit in led if fit is not None), None)


def _guess_of(fit: Fit) -> ShapeGuess:
    return ShapeGuess(fit.T_world_shape, np.asarray(fit.radius_m), np.asarray(fit.angle_rad))


def _vague_parameter(fit: Fit) -> str:
    """What is known so badly that its standard deviation means nothing; empty if all is well."""
    if fit.shape is FitShape.CONE and (angle := fit.deviation("angle")) > MAX_RELATIVE_SIGMA:
        return f"its angle is known to {np.degrees(angle):.1f} degrees only"
    if (
        fit.shape is not FitShape.PLANE
        and (radius := fit.deviation("radius")) > MAX_RELATIVE_SIGMA * fit.radius_m
    ):
        return f"its radius is known to {1e3 * radius:.3g} mm only"
    if fit.shape is not FitShape.SPHERE and (tilt := _tilt_rad(fit)) > MAX_RELATIVE_SIGMA:
        return f"its direction is known to {np.degrees(tilt):.1f} degrees only"
    return ""


def _tilt_rad(fit: Fit) -> float:
    """The standard deviation of the tilt towards the least known side."""
    tilts = [SHAPE_PARAMETERS[fit.shape].index(name) for name in ("tilt_x", "tilt_y")]
    return float(np.sqrt(np.linalg.eigvalsh(fit.covariance[np.ix_(tilts, tilts)])[-1]))


def _senseless_cloud(shape: FitShape, cloud: Cloud) -> str | None:
    least = max(SAMPLE_SIZES[shape], len(SHAPE_PARAMETERS[shape]) + 1)
    if len(cloud.points) < least:
        return f"a {shape} needs at least {least} points, there are {len(cloud.points)}"
    return why_unfittable(cloud.points, cloud.sigma_m)


@dataclass(frozen=True, slots=True, eq=False)
class _LocalPoints:
    """Points in the frame of a shape: distances and slopes by standard deviations, a row for
    each number; and these in metres.
    """

    off: Floats
    by: Floats
    sigma: Floats


def _settle_shape(shape: FitShape, cloud: Cloud, among: Truths, guess: ShapeGuess) -> Fit | None:
    """The shape after the points that belong to it, among some, have settled; None if they do
    not, or leave it loose.
    """
    at, used, limit = guess, np.zeros(len(cloud.points), bool), np.inf
    for _ in range(MAX_CHOICE_ROUNDS):
        off = _worst_deviation(_local_points(shape, cloud, at), shape)
        limit = max(BELONGING_SIGMAS, min(limit / 2, USUAL_MEDIANS * float(np.median(off))))
        now = among & (off <= limit)
        if limit == BELONGING_SIGMAS and (now == used).all():
            return _finish_fit(shape, cloud, at, used)
        if now.sum() <= len(SHAPE_PARAMETERS[shape]):
            return None
        used, moved = now, _least_squares(shape, cloud, at, now)
        if moved is None:
            return None
        at = moved
    return _finish_fit(shape, cloud, at, used)


def _worst_deviation(local: _LocalPoints, shape: FitShape) -> Floats:
    """How far each point is off (n,), by its standard deviations."""
    rows = 2 if shape is FitShape.CIRCLE else 1
    deviations: Floats = np.abs(local.off).reshape(-1, rows).max(axis=1)
    return deviations


def _local_points(
    shape: FitShape, cloud: Cloud, at: ShapeGuess, sigma: Floats | None = None
) -> _LocalPoints:
    """The points in the frame of a shape; `sigma` (rows,), if given, stands for the standard
    deviations that follow from the shape.
    """
    points = apply(inverse(at.T), cloud.points)
    radius, angle = float(at.radius_m), float(at.angle_rad)
    if cloud.directions is not None and shape is not FitShape.CIRCLE:
        off, by, own = _range_excess(shape, cloud, at, points)
    else:
        off = shape_distances(
            shape, points, np.asarray(at.radius_m), np.asarray(at.angle_rad)
        ).ravel()
        by = distance_slopes(shape, points, radius, angle).reshape(len(off), -1)
        own = _sigma_square_to_shape(shape, cloud, at, points).ravel()
    sigma = own if sigma is None else sigma
    return _LocalPoints(off / sigma, by / sigma[:, None], sigma)


def _sigma_square_to_shape(shape: FitShape, cloud: Cloud, at: ShapeGuess, points: Floats) -> Floats:
    """The standard deviations (n, rows) square to a shape."""
    rows = 2 if shape is FitShape.CIRCLE else 1
    sigma: Floats = np.broadcast_to(cloud.sigma_m[:, None], (len(points), rows))
    if cloud.directions is None:
        return sigma
    beams = cloud.directions @ at.T[:3, :3]
    facing = np.abs(
        (distance_normals(shape, points, float(at.angle_rad)) * beams[:, None]).sum(axis=-1)
    )
    sigma_square: Floats = sigma * np.maximum(facing, GRAZING_COSINE)
    return sigma_square


def _range_excess(
    shape: FitShape, cloud: Cloud, at: ShapeGuess, points: Floats
) -> tuple[Floats, Floats, Floats]:
    """By how much each range is too long (n,), how that changes with the shape (n, p), and its
    standard deviation (n,).
    """
    assert cloud.directions is not None
    radius, angle = float(at.radius_m), float(at.angle_rad)
    hits = beam_hits(shape, points, cloud.directions @ at.T[:3, :3], radius, angle)
    sigma = cloud.sigma_m
    if cloud.pointing_m is not None:
        tangent = np.sqrt(np.maximum(1.0 - hits.facing**2, 0.0)) / np.abs(hits.facing)
        sigma = np.hypot(sigma, cloud.pointing_m * tangent)
    return (
        hits.behind_m,
        distance_slopes(shape, hits.feet, radius, angle)[:, 0] / hits.facing[:, None],
        sigma,
    )


def _least_squares(
    shape: FitShape, cloud: Cloud, at: ShapeGuess, used: Truths
) -> ShapeGuess | None:
    """The nearest shape with the least squares over the used points: steps of Gauss and Newton,
    halved where they overshoot.

    The weights stay those of the first shape. If they followed each step, the least sum would be at
    a shape that makes the deviations look large, not at the one that the points lie on.
    """
    some = _select_points(cloud, used)
    at = _centre_shape(shape, some, at)
    local = _local_points(shape, some, at)
    cost = float(local.off @ local.off)
    for _ in range(MAX_FIT_STEPS):
        step, *_ = np.linalg.lstsq(local.by, -local.off, rcond=LOOSE_PARAMETER)
        if not np.isfinite(step).all():
            return None
        for part in STEP_SHARES:
            moved = _centre_shape(
                shape, some, _step_shape(shape, at, np.asarray(part * step, float))
            )
            moved_local = _local_points(shape, some, moved, local.sigma)
            if (now := float(moved_local.off @ moved_local.off)) <= cost:
                break
        else:
            return at
        gained, at, local, cost = cost - now, moved, moved_local, now
        if gained < LAST_STEP_SIGMAS**2:
            break
    return at


def _select_points(cloud: Cloud, used: Truths) -> Cloud:
    beams = (cloud.directions, cloud.beam_m, cloud.pointing_m, cloud.range_m)
    return Cloud(
        cloud.points[used],
        cloud.sigma_m[used],
        *(None if beam is None else beam[used] for beam in beams),
    )


def _step_shape(shape: FitShape, at: ShapeGuess, step: Floats) -> ShapeGuess:
    """The shape after its parameters have changed by a step (p,)."""
    by = dict(zip(SHAPE_PARAMETERS[shape], step.tolist(), strict=True))
    x, y, z, a, b = (by.get(name, 0.0) for name in ("x", "y", "z", "tilt_x", "tilt_y"))
    T = at.T @ transform(rotation_by_vector(np.array([-b, a, 0.0])), (x, y, z))
    radius, angle = at.radius_m + by.get("radius", 0.0), at.angle_rad + by.get("angle", 0.0)
    return ShapeGuess(T, np.asarray(radius), np.asarray(angle))


def _centre_shape(shape: FitShape, cloud: Cloud, at: ShapeGuess) -> ShapeGuess:
    """The same shape with its origin amid the points, as far as it may move along the shape."""
    x, y, z = apply(inverse(at.T), cloud.points.mean(axis=0, keepdims=True))[0]
    shift = {
        FitShape.PLANE: (x, y, 0.0),
        FitShape.CYLINDER: (0.0, 0.0, z),
        FitShape.CONE: (0.0, 0.0, z),
    }.get(shape)
    if shift is None:
        return at
    wider = shift[2] * np.tan(at.angle_rad)
    return replace(
        at, T=at.T @ transform(np.eye(3), shift), radius_m=np.asarray(at.radius_m + wider)
    )


def _finish_fit(shape: FitShape, cloud: Cloud, at: ShapeGuess, used: Truths) -> Fit | None:
    """The fit with its covariance; None if the points leave something loose, or if it is turned
    inside out.
    """
    at = _towards_widening(at)
    local = _local_points(shape, _select_points(cloud, used), at)
    values, vectors = np.linalg.eigh(_scaled_normal_matrix(local.by))
    if (
        values[0] <= LOOSE_PARAMETER * values[-1]
        or at.radius_m < 0
        or not abs(at.angle_rad) < np.pi / 2
    ):
        return None
    scale = np.sqrt((local.by**2).sum(axis=0))
    covariance = (vectors / values) @ vectors.T / np.outer(scale, scale)
    freedom = len(local.off) - len(SHAPE_PARAMETERS[shape])
    chi2 = float(local.off @ local.off)
    return Fit(
        shape, at.T, float(at.radius_m), float(at.angle_rad), covariance, used, chi2, freedom
    )


def _towards_widening(at: ShapeGuess) -> ShapeGuess:
    """The same shape with its z axis towards where it widens."""
    if at.angle_rad >= 0:
        return at
    return ShapeGuess(at.T @ np.diag([1.0, -1.0, -1.0, 1.0]), at.radius_m, -at.angle_rad)


def _scaled_normal_matrix(by: Floats) -> Floats:
    """The normal matrix (p, p) of parameters that are scaled to matter alike."""
    scaled = by / np.sqrt((by**2).sum(axis=0))
    normal_matrix: Floats = scaled.T @ scaled
    return normal_matrix

"""Which of several parts are seen, by relations between faces and by outlines, and where.

Each face that is seen is one facet of the part, or belongs to something else. This is a constraint
search (Grimson & Lozano-Perez, "Model-based recognition and localization from sparse range or
tactile data", 1984; faces as in Magee & Nathan 1985): a face is no larger than its facet; two faces
have the angle between their facets, and as parallel ones the distance; no two points of them are
farther apart than the facets' are. Three facets that are not parallel settle the pose. Two leave a
shift along both, which the ends of the larger face settle; one tells too little.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from scipy import ndimage

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.rigid import transform
from cellwright.engine.model.vision import (
    DepthImage,
    NamedPart,
    PartSight,
    PixelWindow,
    PoseHypothesis,
    Recognised,
    UnclearParts,
    Unexplained,
)
from cellwright.engine.stages.vision.part_localisation import (
    BeliefDemands,
    KnownScene,
    below_floor,
    doubt_reason,
    hypothesis_worth,
    may_stand,
    part_sightings,
    same_pose,
)
from cellwright.engine.stages.vision.plane_regions import (
    SeenFace,
    axes_of,
    count_directions,
    face_of,
    faces_of,
    farthest_distance,
    regions_of,
)
from cellwright.engine.stages.vision.pose_hypotheses import PartModel, inside_edges
from cellwright.engine.stages.vision.pose_refinement import ImageView, picture_part

LEAST_RANK = 2  # directions that faces must span
ANGLE_RAD, LENGTH_M, AREA = np.radians(4.0), 0.004, 1.15  # what relations may differ by
MIN_SPAN = 0.25  # singular value of normals: less is no direction of its own
LEFT_OUT = 2  # faces that would fit and may belong to something else all the same
MAX_INTERPRETATIONS = 400  # interpretations that begin with one face
MIN_SHOWN_SHARE = 0.85  # of what a face shows must lie in its facet


@dataclass(frozen=True, slots=True)
class FacePairing:
    """A face that is seen and the facet that it is taken for."""

    seen: SeenFace
    facet: SeenFace


Interpretation = tuple[FacePairing, ...]


def related_poses(model: PartModel, seen: Sequence[SeenFace]) -> list[Floats]:
    """Poses T_eye_part (4, 4) that two or more of the faces give, those first that explain most
    pixels.
    """
    facets = faces_of(model.solid)
    poses = []
    for n in range(len(seen)):
        for interpretation in islice(interpretations_of(seen[n:], facets), MAX_INTERPRETATIONS):
            T = (
                pose_from_pairings(interpretation)
                if _interpretation_rank(interpretation) >= LEAST_RANK
                else None
            )
            if T is not None and all(
                _within_facet(T, pairing, model) for pairing in interpretation
            ):
                poses.append((sum(pairing.seen.pixels for pairing in interpretation), T))
    return [T for _, T in sorted(poses, key=lambda pair: -pair[0])]


def interpretations_of(
    seen: Sequence[SeenFace], facets: Sequence[SeenFace]
) -> Iterator[Interpretation]:
    """All ways to take the first face, and some of the others, for facets so that all relations
    hold.
    """

    def extended(n: int, so_far: Interpretation, left_out: int) -> Iterator[Interpretation]:
        if n == len(seen):
            yield so_far
            return
        taken, fits = {id(pairing.facet) for pairing in so_far}, False
        for facet in facets:
            pairing = FacePairing(seen[n], facet)
            if id(facet) not in taken and _fits_with(pairing, so_far):
                fits = True
                yield from extended(n + 1, (*so_far, pairing), left_out)
        if so_far and left_out + fits <= LEFT_OUT:
            yield from extended(n + 1, so_far, left_out + fits)

    yield from extended(0, (), 0)


def _fits_with(new: FacePairing, so_far: Interpretation) -> bool:
    """Whether a face can be a facet, beside those that are taken already."""
    return new.seen.area_m2 <= AREA * new.facet.area_m2 and all(
        _faces_relate(new, pairing) for pairing in so_far
    )


def _faces_relate(first: FacePairing, second: FacePairing) -> bool:
    """Whether two faces stand to each other as their facets do."""
    seen, model = (
        _angle_of_normals(a.normal, b.normal)
        for a, b in ((first.seen, second.seen), (first.facet, second.facet))
    )
    if abs(seen - model) > ANGLE_RAD:
        return False
    if model < ANGLE_RAD or model > np.pi - ANGLE_RAD:
        side = 1.0 if model < 1.0 else -1.0
        # The planes' offsets differ by what one is above the other, at the points of one of them.
        gap = float((second.seen.points @ first.seen.normal).mean()) - first.seen.offset_m
        expected = side * second.facet.offset_m - first.facet.offset_m
        if abs(gap - expected) > LENGTH_M:
            return False
    apart = farthest_distance(first.seen.points, second.seen.points)
    return apart <= farthest_distance(first.facet.points, second.facet.points) + 2 * LENGTH_M


def _angle_of_normals(first: Floats, second: Floats) -> float:
    return float(np.arccos(np.clip(first @ second, -1.0, 1.0)))


def _interpretation_rank(interpretation: Interpretation) -> int:
    return count_directions([pairing.facet.normal for pairing in interpretation], MIN_SPAN)


def pose_from_pairings(pairings: Interpretation) -> Floats | None:
    """The pose (4, 4) that brings facets onto the faces: a rotation by their normals (Wahba's
    problem), then a shift.

    None if the faces' normals are those of the mirrored part.
    """
    weights = np.array([float(pairing.seen.pixels) for pairing in pairings])
    seen = np.array([pairing.seen.normal for pairing in pairings])
    own = np.array([pairing.facet.normal for pairing in pairings])
    U, _, Vt = np.linalg.svd((seen * weights[:, None]).T @ own)
    R = U @ np.diag([1.0, 1.0, float(np.linalg.det(U @ Vt))]) @ Vt
    if (np.arccos(np.clip((seen * (own @ R.T)).sum(axis=1), -1.0, 1.0)) > ANGLE_RAD).any():
        return None
    offsets = np.array([pairing.seen.offset_m - pairing.facet.offset_m for pairing in pairings])
    rows, targets = seen * np.sqrt(weights)[:, None], offsets * np.sqrt(weights)
    if count_directions(list(own), MIN_SPAN) < 3:
        along = np.linalg.svd(seen)[2][2]
        largest = max(pairings, key=lambda pairing: pairing.seen.pixels)
        rows = np.concatenate([rows, along[None]])
        targets = np.append(
            targets,
            _middle_of(largest.seen.points @ along)
            - _middle_of(largest.facet.points @ R.T @ along),
        )
    shift, *_ = np.linalg.lstsq(rows, targets, rcond=None)
    return transform(R, np.asarray(shift, float))


def _middle_of(along: Floats) -> float:
    return float(along.min() + along.max()) / 2.0


def _within_facet(T: Floats, pairing: FacePairing, model: PartModel) -> bool:
    """Whether the points of a face lie inside its facet, with the part at a pose."""
    facet = model.solid.facets[pairing.facet.number]
    axes = axes_of(facet.normal)[:, :2]
    own = (pairing.seen.points - T[:3, 3]) @ T[:3, :3]
    return bool(inside_edges(own @ axes, facet.edges @ axes).mean() >= MIN_SHOWN_SHARE)


MAX_INTERPRETED_FACES = 24  # that are interpreted, the largest
MAX_RELATED_POSES = (
    40  # poses of one part that relations between faces give, those with the most pixels first
)
# of the pixels of the smaller one: two sights that share so many explain the same thing
MAX_OVERLAP = 0.2
AHEAD_SHARE = 0.03  # of its evidence: so much better must the best part explain the image
FACE_PX = 25  # of a facet that is seen
NEAR, SLACK_M = (
    5.0,
    0.004,
)  # of the noise, and what is added where a face leans: so near to the part, a pixel shows it
BESIDE_PX, LEAST_PX = 2, 120  # around what is explained; of what is told to be unexplained
RECOGNITION_DEMANDS = BeliefDemands()
NO_MATCHING_FACES = "nothing that is left in the image has faces or edges like its own"
UNSUPPORTED_FACE = (
    "only one of its faces is seen, and nothing says what carries it; look from where two or "
    "three meet"
)


@dataclass(frozen=True, slots=True, eq=False)
class PartClaim:
    """A part at a pose that the image confirms, what speaks for it, and the pixels (height, width)
    that show it.

    `stands` says whether it rests on what carries it, or nothing is known of that.
    """

    sight: PartSight
    evidence: float
    shows: Truths
    stands: bool = True


def recognise_in_image(
    models: Mapping[str, PartModel], image: DepthImage, ground: KnownScene
) -> Recognised:
    """The parts that are seen, what may be one of several, and what belongs to none.

    `ground` says what of the image is known to be something else, and which planes carry parts.
    """
    open_models, known_mask = dict(models), ground.known
    named: list[NamedPart] = []
    unclear: list[UnclearParts] = []
    doubts: dict[str, str] = {}
    while open_models:
        claims, doubts = _part_claims(open_models, image, replace(ground, known=known_mask))
        more, unclear = decide_claims(claims, models)
        named += more
        open_models = {
            name: open_models[name]
            for name in open_models
            if name not in {identified.best.part for identified in named}
        }
        if not more:
            break
        known_mask = known_mask | _explained_pixels(
            models, image, [identified.best for identified in named]
        )
    unclear_parts = {part for doubtful in unclear for part in doubtful.parts}
    missing = {
        name: doubts.get(name, NO_MATCHING_FACES)
        for name in sorted(open_models)
        if name not in unclear_parts
    }
    sights = [identified.best for identified in named] + [
        sight for doubtful in unclear for sight in doubtful.sights
    ]
    rest = _unexplained_regions(image, ground.known | _explained_pixels(models, image, sights))
    return Recognised(tuple(named), tuple(unclear), tuple(rest), missing)


def _part_claims(
    models: Mapping[str, PartModel], image: DepthImage, ground: KnownScene
) -> tuple[list[PartClaim], dict[str, str]]:
    """The parts at all poses that the image confirms; and for parts without any, why there is
    none.
    """
    regions = regions_of(image, ground.known)
    view, faces = (
        ImageView(image, ground.known),
        [face_of(image, region) for region in regions[:MAX_INTERPRETED_FACES]],
    )
    claims: list[PartClaim] = []
    doubts: dict[str, str] = {}
    for name, model in sorted(models.items()):
        seen = part_sightings(model, view, regions, related_poses(model, faces)[:MAX_RELATED_POSES])
        reasons = [
            _unsupported_reason(model, hypothesis.T_camera_part, view, ground)
            or doubt_reason(hypothesis, RECOGNITION_DEMANDS)
            for hypothesis, _ in seen
        ]
        sure = [hypothesis for (hypothesis, _), why in zip(seen, reasons, strict=True) if not why]
        claims += [_make_claim(name, model, hypothesis, view, ground) for hypothesis in sure]
        if seen and not sure:
            doubts[name] = max(
                zip(seen, reasons, strict=True), key=lambda pair: hypothesis_worth(pair[0][0])
            )[1]
    return claims, doubts


def _make_claim(
    name: str, model: PartModel, hypothesis: PoseHypothesis, view: ImageView, ground: KnownScene
) -> PartClaim:
    shows, normals = _shown_pixels(model, hypothesis.T_camera_part, view.image)
    sight = PartSight(
        name, hypothesis.T_camera_part, int(shows.sum()), hypothesis.seen, len(normals)
    )
    return PartClaim(
        sight, hypothesis.evidence, shows, may_stand(model, hypothesis.T_camera_part, view, ground)
    )


def _shown_pixels(model: PartModel, T: Floats, image: DepthImage) -> tuple[Truths, list[Floats]]:
    """The pixels (height, width) that show a part at a pose, and the normals (3,) of its facets
    that they show.
    """
    shows = np.zeros(image.depth.shape, dtype=bool)
    seen = picture_part(model, image, T)
    if seen is None:
        return shows, []
    down, right = np.gradient(seen.depth)
    slack = np.minimum(np.hypot(down, right), SLACK_M)  # what the next pixel differs by
    own = np.abs(seen.apart) < NEAR * image.noise_m + slack
    shows[seen.v0 : seen.v0 + own.shape[0], seen.u0 : seen.u0 + own.shape[1]] = own
    counts = np.bincount(seen.owner[own], minlength=len(model.solid.facets))
    return shows, [model.solid.facets[n].normal for n in np.flatnonzero(counts >= FACE_PX)]


def _unsupported_reason(model: PartModel, T: Floats, view: ImageView, ground: KnownScene) -> str:
    """Why a pose that an image confirms is not believed all the same; empty if it is."""
    if below_floor(model, T, ground):
        return "it would reach below the floor"
    if count_directions(_shown_pixels(model, T, view.image)[1], MIN_SPAN) >= LEAST_RANK:
        return ""
    if not ground.floors:
        return UNSUPPORTED_FACE
    return "" if may_stand(model, T, view, ground) else "it would rest on nothing"


def decide_claims(
    claims: Sequence[PartClaim], models: Mapping[str, PartModel]
) -> tuple[list[NamedPart], list[UnclearParts]]:
    """The parts that claims settle, and what stays open: each part is there once, and what
    shows one part shows no other.
    """
    open_ = _group_claims(claims)
    named: list[NamedPart] = []
    while True:
        alone = [
            name
            for group in open_
            if len(_claimed_parts(group)) == 1
            for name in _claimed_parts(group)
        ]
        sure = sorted(name for name in set(alone) if alone.count(name) == 1)
        if not sure:
            return named, [UnclearParts(tuple(_best_sights(group))) for group in open_]
        settled = [
            group
            for group in open_
            if len(_claimed_parts(group)) == 1 and _claimed_parts(group) <= set(sure)
        ]
        named += [_name_part(group, models[group[0].sight.part]) for group in settled]
        undecided = [
            tuple(claim for claim in group if claim.sight.part not in sure) for group in open_
        ]
        open_ = [group for group in undecided if group]


def _claimed_parts(group: Sequence[PartClaim]) -> set[str]:
    return {claim.sight.part for claim in group}


def _group_claims(claims: Sequence[PartClaim]) -> list[tuple[PartClaim, ...]]:
    """Claims that explain the same pixels, the best first; without those that are clearly
    behind, or hang in the air beside one that stands.
    """
    rest = sorted(claims, key=lambda claim: -claim.evidence)
    groups = []
    while rest:
        together = [claim for claim in rest if _claims_overlap(rest[0], claim)]
        near = [
            claim for claim in together if claim.evidence >= (1.0 - AHEAD_SHARE) * rest[0].evidence
        ]
        groups.append(tuple([claim for claim in near if claim.stands] or near))
        rest = [claim for claim in rest if not any(claim is member for member in together)]
    return groups


def _claims_overlap(first: PartClaim, second: PartClaim) -> bool:
    both = int((first.shows & second.shows).sum())
    return first is second or both > MAX_OVERLAP * min(first.sight.pixels, second.sight.pixels)


def _best_sights(group: Sequence[PartClaim]) -> list[PartSight]:
    """The best sight of each part in a group."""
    best_sights: dict[str, PartSight] = {}
    for claim in group:
        best_sights.setdefault(claim.sight.part, claim.sight)
    return list(best_sights.values())


def _name_part(group: Sequence[PartClaim], model: PartModel) -> NamedPart:
    poses: list[Floats] = []
    for claim in group:
        if not any(same_pose(model, T, claim.sight.T_eye_part) for T in poses):
            poses.append(claim.sight.T_eye_part)
    best = group[0].sight
    return NamedPart(best, tuple(poses), tuple(best.T_eye_part @ S for S in model.symmetries))


def _explained_pixels(
    models: Mapping[str, PartModel], image: DepthImage, sights: Sequence[PartSight]
) -> Truths:
    """The pixels (height, width) that show parts, and those close beside them, where beams meet
    both.
    """
    explained = np.zeros(image.depth.shape, dtype=bool)
    for sight in sights:
        explained |= _shown_pixels(models[sight.part], sight.T_eye_part, image)[0]
    return np.asarray(ndimage.binary_dilation(explained, iterations=BESIDE_PX))


def _unexplained_regions(image: DepthImage, known: Truths) -> list[Unexplained]:
    """What is seen and belongs to nothing, the largest first."""
    open_ = ndimage.binary_opening((image.depth > 0) & ~known, iterations=2)
    label, count = ndimage.label(open_)
    regions = []
    for n, box in enumerate(ndimage.find_objects(label, max_label=count)):
        own = label[box] == n + 1
        if own.sum() < LEAST_PX:
            continue
        v, u = np.nonzero(own)
        rows, columns = box
        u, v = u + columns.start, v + rows.start
        points = image.camera.rays(u.astype(float), v.astype(float)) * image.depth[v, u][:, None]
        window = PixelWindow(columns.start, rows.start, columns.stop, rows.stop)
        x, y, z = (float(coordinate) for coordinate in np.median(points, axis=0))
        regions.append(Unexplained(int(own.sum()), window, (x, y, z)))
    return sorted(regions, key=lambda region: -region.pixels)

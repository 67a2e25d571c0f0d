"""Which of several parts are seen, by the relations between their faces and by the outlines of these, and where they are.

A part is suggested by two or three faces (`relations`), or by the edges of one (`hypotheses`); the whole image betters each pose and judges
it. Then all parts are decided together: what shows one part shows no other, and each part is there once. So what may be one of two parts
is the one that is left when the other one is found elsewhere. What is explained is taken out of the image, and parts that are not found
yet are looked for in the rest.

One face alone tells a part only by what carries it: its height there is the distance to the face that it lies on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.model.ranging import Named, Recognised, Sight, Unclear, Unexplained, Window
from cellwright.engine.model.vision import DepthImage, Hypothesis
from cellwright.engine.stages.vision.faces import face_of, independent
from cellwright.engine.stages.vision.hypotheses import Model
from cellwright.engine.stages.vision.localisation import (
    Demands,
    Ground,
    below,
    doubt,
    same,
    sightings,
    stands,
    worth,
)
from cellwright.engine.stages.vision.outlines import regions_of
from cellwright.engine.stages.vision.refinement import View, look
from cellwright.engine.stages.vision.relations import LEAST_RANK, SPANS, related_poses

FACES = 24  # that are interpreted, the largest
RELATED = 40  # poses of one part that relations between faces give, those with the most pixels first
OVERLAP = 0.2  # of the pixels of the smaller one: two sights that share so many explain the same thing
AHEAD = 0.03  # of its evidence: so much better must the best part explain the image
FACE_PX = 25  # of a facet that is seen
NEAR, SLACK_M = (
    5.0,
    0.004,
)  # of the noise, and what is added where a face leans: so near to the part, a pixel shows it
BESIDE_PX, LEAST_PX = 2, 120  # around what is explained; of what is told to be unexplained
DEMANDS = Demands()
NOTHING = "nothing that is left in the image has faces or edges like its own"
LOOSE = "only one of its faces is seen, and nothing says what carries it; look from where two or three meet"


@dataclass(frozen=True, slots=True, eq=False)
class Claim:
    """A part at a pose that the image confirms, what speaks for it, and the pixels (height, width) that show it.

    `stands` says whether it rests on what carries it, or nothing is known of that.
    """

    sight: Sight
    evidence: float
    shows: Truths
    stands: bool = True


def recognised(models: Mapping[str, Model], image: DepthImage, ground: Ground) -> Recognised:
    """The parts that are seen, what may be one of several, and what belongs to none.

    `ground` says what of the image is known to be something else, and which planes carry parts.
    """
    left, known = dict(models), ground.known
    named: list[Named] = []
    unclear: list[Unclear] = []
    doubts: dict[str, str] = {}
    while left:
        claims, doubts = _claims(left, image, replace(ground, known=known))
        more, unclear = decided(claims, models)
        named += more
        left = {name: left[name] for name in left if name not in {each.best.part for each in named}}
        if not more:
            break
        known = known | _explained(models, image, [each.best for each in named])
    told = {part for each in unclear for part in each.parts}
    missing = {name: doubts.get(name, NOTHING) for name in sorted(left) if name not in told}
    sights = [each.best for each in named] + [sight for each in unclear for sight in each.sights]
    rest = _unexplained(image, ground.known | _explained(models, image, sights))
    return Recognised(tuple(named), tuple(unclear), tuple(rest), missing)


def _claims(
    models: Mapping[str, Model], image: DepthImage, ground: Ground
) -> tuple[list[Claim], dict[str, str]]:
    """The parts at all poses that the image confirms; and for parts without any, why there is none."""
    regions = regions_of(image, ground.known)
    view, faces = View(image, ground.known), [face_of(image, each) for each in regions[:FACES]]
    found: list[Claim] = []
    doubts: dict[str, str] = {}
    for name, model in sorted(models.items()):
        seen = sightings(model, view, regions, related_poses(model, faces)[:RELATED])
        reasons = [
            _loose(model, each.T_camera_part, view, ground) or doubt(each, DEMANDS) for each, _ in seen
        ]
        sure = [each for (each, _), why in zip(seen, reasons, strict=True) if not why]
        found += [_claim(name, model, each, view, ground) for each in sure]
        if seen and not sure:
            doubts[name] = max(zip(seen, reasons, strict=True), key=lambda pair: worth(pair[0][0]))[1]
    return found, doubts


def _claim(name: str, model: Model, each: Hypothesis, view: View, ground: Ground) -> Claim:
    shows, normals = _shown(model, each.T_camera_part, view.image)
    sight = Sight(name, each.T_camera_part, int(shows.sum()), each.seen, len(normals))
    return Claim(sight, each.evidence, shows, stands(model, each.T_camera_part, view, ground))


def _shown(model: Model, T: Floats, image: DepthImage) -> tuple[Truths, list[Floats]]:
    """The pixels (height, width) that show a part at a pose, and the normals (3,) of its facets that they show."""
    shows = np.zeros(image.depth.shape, dtype=bool)
    seen = look(model, image, T)
    if seen is None:
        return shows, []
    down, right = np.gradient(seen.depth)
    slack = np.minimum(np.hypot(down, right), SLACK_M)  # what the next pixel differs by
    own = np.abs(seen.apart) < NEAR * image.noise_m + slack
    shows[seen.v0 : seen.v0 + own.shape[0], seen.u0 : seen.u0 + own.shape[1]] = own
    counts = np.bincount(seen.owner[own], minlength=len(model.solid.facets))
    return shows, [model.solid.facets[n].normal for n in np.flatnonzero(counts >= FACE_PX)]


def _loose(model: Model, T: Floats, view: View, ground: Ground) -> str:
    """Why a pose that an image confirms is not believed all the same; empty if it is."""
    if below(model, T, ground):
        return "it would reach below the floor"
    if independent(_shown(model, T, view.image)[1], SPANS) >= LEAST_RANK:
        return ""
    if not ground.floors:
        return LOOSE
    return "" if stands(model, T, view, ground) else "it would rest on nothing"


def decided(claims: Sequence[Claim], models: Mapping[str, Model]) -> tuple[list[Named], list[Unclear]]:
    """The parts that claims settle, and what stays open: each part is there once, and what shows one part shows no other."""
    open_ = _groups(claims)
    named: list[Named] = []
    while True:
        alone = [name for group in open_ if len(_parts(group)) == 1 for name in _parts(group)]
        sure = sorted(name for name in set(alone) if alone.count(name) == 1)
        if not sure:
            return named, [Unclear(tuple(_best(group))) for group in open_]
        settled = [group for group in open_ if len(_parts(group)) == 1 and _parts(group) <= set(sure)]
        named += [_named(group, models[group[0].sight.part]) for group in settled]
        left = [tuple(each for each in group if each.sight.part not in sure) for group in open_]
        open_ = [group for group in left if group]


def _parts(group: Sequence[Claim]) -> set[str]:
    return {each.sight.part for each in group}


def _groups(claims: Sequence[Claim]) -> list[tuple[Claim, ...]]:
    """Claims that explain the same pixels, the best first; without those that are clearly behind, or hang in the air beside one that stands."""
    rest = sorted(claims, key=lambda each: -each.evidence)
    groups = []
    while rest:
        together = [each for each in rest if _overlap(rest[0], each)]
        near = [each for each in together if each.evidence >= (1.0 - AHEAD) * rest[0].evidence]
        groups.append(tuple([each for each in near if each.stands] or near))
        rest = [each for each in rest if not any(each is other for other in together)]
    return groups


def _overlap(one: Claim, other: Claim) -> bool:
    both = int((one.shows & other.shows).sum())
    return one is other or both > OVERLAP * min(one.sight.pixels, other.sight.pixels)


def _best(group: Sequence[Claim]) -> list[Sight]:
    """The best sight of each part in a group."""
    found: dict[str, Sight] = {}
    for each in group:
        found.setdefault(each.sight.part, each.sight)
    return list(found.values())


def _named(group: Sequence[Claim], model: Model) -> Named:
    poses: list[Floats] = []
    for each in group:
        if not any(same(model, T, each.sight.T_eye_part) for T in poses):
            poses.append(each.sight.T_eye_part)
    best = group[0].sight
    return Named(best, tuple(poses), tuple(best.T_eye_part @ S for S in model.symmetries))


def _explained(models: Mapping[str, Model], image: DepthImage, sights: Sequence[Sight]) -> Truths:
    """The pixels (height, width) that show parts, and those close beside them, where beams meet both."""
    found = np.zeros(image.depth.shape, dtype=bool)
    for each in sights:
        found |= _shown(models[each.part], each.T_eye_part, image)[0]
    return np.asarray(ndimage.binary_dilation(found, iterations=BESIDE_PX))


def _unexplained(image: DepthImage, known: Truths) -> list[Unexplained]:
    """What is seen and belongs to nothing, the largest first."""
    open_ = ndimage.binary_opening((image.depth > 0) & ~known, iterations=2)
    label, count = ndimage.label(open_)
    found = []
    for n, box in enumerate(ndimage.find_objects(label, max_label=count)):
        own = label[box] == n + 1
        if own.sum() < LEAST_PX:
            continue
        v, u = np.nonzero(own)
        rows, columns = box
        u, v = u + columns.start, v + rows.start
        points = image.camera.rays(u.astype(float), v.astype(float)) * image.depth[v, u][:, None]
        window = Window(columns.start, rows.start, columns.stop, rows.stop)
        x, y, z = (float(each) for each in np.median(points, axis=0))
        found.append(Unexplained(int(own.sum()), window, (x, y, z)))
    return sorted(found, key=lambda each: -each.pixels)

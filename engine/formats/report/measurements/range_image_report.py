"""Range images and what was measured and recognised in them, as pictures, text and data."""

import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from PIL import Image, ImageDraw
from rich.text import Text

from cellwright.engine.formats.report.measurements import fit_report
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.shape_fits import Fit, Fitting, Related
from cellwright.engine.model.vision import (
    EdgeImage,
    EdgeKind,
    NamedPart,
    PartSight,
    PixelWindow,
    RangeImage,
    Recognised,
    Unexplained,
)
from cellwright.engine.pipelines.motion.measured_surface import MeasuredSurface

NO_ANSWER_COLOUR = (70, 90, 160)
EDGE_COLOURS = {
    EdgeKind.STEP: (230, 60, 40),
    EdgeKind.ROOF: (250, 210, 40),
    EdgeKind.CREASE: (60, 200, 90),
}
PATCH_FRAME_COLOUR = (240, 120, 240)


def range_image_png(
    image: RangeImage,
    edges: EdgeImage | None = None,
    windows: Mapping[str, PixelWindow] | None = None,
) -> bytes:
    """The PNG of an image: near is light, blue has no answer; steps are red, roofs yellow,
    creases green, patches framed.
    """
    seen = image.range_m > 0
    low, high = (
        (float(x) for x in np.percentile(image.range_m[seen], (0.5, 99.5)))
        if seen.any()
        else (0.0, 1.0)
    )
    grey = (235 - 200 * np.clip((image.range_m - low) / max(high - low, 1e-6), 0, 1)).astype(
        np.uint8
    )
    shown = np.where(
        seen[..., None], grey[..., None], np.array(NO_ANSWER_COLOUR, dtype=np.uint8)
    ).astype(np.uint8)
    for kind, colour in EDGE_COLOURS.items() if edges is not None else ():
        shown[edges.on(kind)] = colour  # type: ignore[union-attr]
    larger = max(1, 512 // max(image.tool.width, image.tool.height))
    drawn = Image.fromarray(shown).resize(
        (larger * shown.shape[1], larger * shown.shape[0]), Image.Resampling.NEAREST
    )
    pen = ImageDraw.Draw(drawn)
    for name, window in (windows or {}).items():
        box = [larger * border for border in (window.left, window.top, window.right, window.bottom)]
        pen.rectangle(box, outline=PATCH_FRAME_COLOUR)
        pen.text((box[0] + 3, box[1] + 2), name, fill=PATCH_FRAME_COLOUR)
    png_buffer = io.BytesIO()
    drawn.save(png_buffer, "PNG")
    return png_buffer.getvalue()


def range_image_line(image: RangeImage) -> str:
    """One line about an image."""
    seen = image.range_m > 0
    size = f"{image.tool.width} x {image.tool.height} pixels"
    if not seen.any():
        return f"{size}, none with an answer"
    kind = "ranges modulo half the wavelength" if image.wrapped else "ranges"
    low, high = (
        1e3 * float(range_limit) for range_limit in np.percentile(image.range_m[seen], (1, 99))
    )
    return f"{size}, {seen.mean():.1%} with an answer; {kind} from {low:.1f} to {high:.1f} mm"


def surface_text(surface: MeasuredSurface) -> Text:
    """Where the surface at a measurement is, and what of the image told it."""
    where = f" from {surface.poses.station}" if surface.poses.station else ""
    window = surface.window
    size = f"{window.right - window.left} x {window.bottom - window.top} pixels"
    lines = [f"{surface.name} with {surface.poses.tool}{where}: {range_image_line(surface.image)}"]
    lines += _missing_knowledge(surface.image)
    lines.append(
        f"patch of {size}, expected to tell the surface to {_sigma_text(surface.expected_m)}"
    )
    if isinstance(surface.fit, Fit):
        lines.append(
            f"the surface is {1e3 * surface.off_m:+.4f} mm from its nominal place, to "
            f"{_sigma_text(surface.sigma_m)};"
            " where the arm holds the tool is taken as exact"
        )
    else:
        lines.append(f"no surface: {surface.fit.reason}")
    return Text("\n".join(lines))


def _sigma_text(sigma_m: float) -> str:
    return f"{1e3 * fit_report.FIT_COVERAGE * sigma_m:.2g} mm"


def surface_content(surface: MeasuredSurface) -> dict[str, Any]:
    """The same as plain values, in metres."""
    window = surface.window
    return {
        "measurement": surface.name,
        "tool": surface.poses.tool,
        "station": surface.poses.station,
        "patch": [window.left, window.top, window.right, window.bottom],
        "expected_sigma": surface.expected_m,
        "answered": float((surface.image.range_m > 0).mean()),
        "fit": fit_report.fit_entry(surface.fit),
        **({"off": surface.off_m, "sigma": surface.sigma_m} if surface.sure else {}),
    }


def dimensions_text(
    image: RangeImage,
    fittings: Mapping[str, Fitting],
    between: Mapping[str, tuple[Related, ...]],
    edges: EdgeImage,
) -> Text:
    """An image, fits in it by name, and what is between them, in sentences."""
    counts = [f"{int(edges.on(kind).sum())} on {kind.name.lower()}s" for kind in EDGE_COLOURS]
    lines = [
        range_image_line(image),
        *_missing_knowledge(image),
        f"pixels at edges: {', '.join(counts)}",
    ]
    for name, fitting in fittings.items():
        fit_text = fit_report.fits_text([fitting], ()).plain.replace(
            "as far as --noise says", "as far as the image says"
        )
        fit_text = fit_text.replace(
            "times as far as --noise says", "times as far as the image says"
        )
        lines += [
            f"{name}: {fit_text.splitlines()[0]}",
            *(f"  {line}" for line in fit_text.splitlines()[1:]),
        ]
    for names, related in between.items():
        lines += [
            f"{names}: {line}" for line in fit_report.fits_text([], related).plain.splitlines()
        ]
        lines += [f"{names}: nothing can be told between these shapes"] if not related else []
    return Text("\n".join(lines))


def _missing_knowledge(image: RangeImage) -> list[str]:
    """What a depth image does not tell."""
    notes = (
        ["strengths are not known: they are taken from distance and slope"] if image.guessed else []
    )
    rounded = (
        f"depths are rounded to {1e3 * image.step_m:.3g} mm: what was rounded alike counts as "
        "one value"
    )
    return [*notes, *([rounded] if image.step_m else [])]


def dimensions_content(
    image: RangeImage,
    fittings: Mapping[str, Fitting],
    between: Mapping[str, tuple[Related, ...]],
    edges: EdgeImage,
) -> dict[str, Any]:
    """The same as plain values, in metres and radians, in the frame of the tool's eye."""
    return {
        "answered": float((image.range_m > 0).mean()),
        "strength_known": not image.guessed,
        "rounded_to": image.step_m,
        "fits": {name: fit_report.fit_entry(fitting) for name, fitting in fittings.items()},
        "between": {
            name: fit_report.related_entries(relations) for name, relations in between.items()
        },
        "edges": {kind.name.lower(): int(edges.on(kind).sum()) for kind in EDGE_COLOURS},
        "refused": sorted(
            name for name, fitting in fittings.items() if not isinstance(fitting, Fit)
        ),
    }


def recognition_text(recognition: Recognised) -> Text:
    """The parts that are seen and where, what is unclear, and why others are not found."""
    return Text("\n".join(_recognition_lines(recognition)) or "there is no part to look for")


def _recognition_lines(recognition: Recognised) -> Iterator[str]:
    for named_part in recognition.named:
        yield from _part_lines(named_part)
    for unclear in recognition.unclear:
        either = (
            f"either {' or '.join(unclear.parts)}"
            if len(unclear.parts) > 1
            else _further_text(unclear.parts[0])
        )
        yield (
            f"{either}, {_sight_place(unclear.sights[0])}: {unclear.sights[0].shown:.0%} of it "
            "is seen"
        )
    for unexplained in recognition.unexplained:
        yield (
            f"no part that is looked for, {_point_text(unexplained.middle_m)}: "
            f"{count_noun(unexplained.pixels, 'pixel')}, {_unexplained_frame(unexplained)}"
        )
    for name, why in recognition.missing.items():
        yield f"{name} is not found: {why}"


def _further_text(part: str) -> str:
    return f"looks like {part}, as does something else"


def _part_lines(named_part: NamedPart) -> Iterator[str]:
    best = named_part.best
    yield (
        f"{best.part}, {_sight_place(best)}: by {count_noun(best.faces, 'face')}, "
        f"{best.shown:.0%} of it is seen"
    )
    if len(named_part.equivalent) > 1:
        yield f"  it is symmetric: {len(named_part.equivalent)} poses look the same"
    if len(named_part.poses) > 1:
        yield f"  {len(named_part.poses)} poses explain the image equally well"


def _sight_place(sight: PartSight) -> str:
    return _point_text([float(coordinate) for coordinate in sight.T_eye_part[:3, 3]])


def _point_text(point: Sequence[float]) -> str:
    return f"at ({', '.join(f'{1e3 * coordinate:z.1f}' for coordinate in point)}) mm from the eye"


def _unexplained_frame(unexplained: Unexplained) -> str:
    window = unexplained.window
    return f"columns {window.left} to {window.right}, rows {window.top} to {window.bottom}"


def recognition_content(recognition: Recognised) -> dict[str, Any]:
    """The same as plain values, in metres."""
    return {
        "parts": [
            {
                **_sight_entry(named_part.best),
                "poses": [T.tolist() for T in named_part.poses],
                "equivalent": [T.tolist() for T in named_part.equivalent],
            }
            for named_part in recognition.named
        ],
        "unclear": [
            [_sight_entry(sight) for sight in unclear.sights] for unclear in recognition.unclear
        ],
        "unexplained": [
            {
                "pixels": region.pixels,
                "frame": [
                    region.window.left,
                    region.window.top,
                    region.window.right,
                    region.window.bottom,
                ],
                "middle": list(region.middle_m),
            }
            for region in recognition.unexplained
        ],
        "missing": dict(recognition.missing),
    }


def _sight_entry(sight: PartSight) -> dict[str, Any]:
    return {
        "part": sight.part,
        "T_eye_part": sight.T_eye_part.tolist(),
        "faces": sight.faces,
        "shown": sight.shown,
    }

"""Range images and what was found in them, as pictures, for people and for programs."""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from PIL import Image, ImageDraw
from rich.text import Text

from cellwright.engine.formats.report import fits
from cellwright.engine.model.fits import Fit, Fitting, Related
from cellwright.engine.model.ranging import EdgeKind, Edges, RangeImage, Window
from cellwright.engine.pipelines.dimensions.surfaces import MeasuredSurface

NOTHING = (70, 90, 160)
COLOURS = {EdgeKind.STEP: (230, 60, 40), EdgeKind.ROOF: (250, 210, 40), EdgeKind.CREASE: (60, 200, 90)}
FRAME = (240, 120, 240)


def picture(
    image: RangeImage, edges: Edges | None = None, windows: Mapping[str, Window] | None = None
) -> bytes:
    """The PNG of an image: near is light, blue has no answer; steps are red, roofs yellow, creases green, patches framed."""
    seen = image.range_m > 0
    low, high = (
        (float(x) for x in np.percentile(image.range_m[seen], (0.5, 99.5))) if seen.any() else (0.0, 1.0)
    )
    grey = (235 - 200 * np.clip((image.range_m - low) / max(high - low, 1e-6), 0, 1)).astype(np.uint8)
    shown = np.where(seen[..., None], grey[..., None], np.array(NOTHING, dtype=np.uint8)).astype(np.uint8)
    for kind, colour in COLOURS.items() if edges is not None else ():
        shown[edges.on(kind)] = colour  # type: ignore[union-attr]
    larger = max(1, 512 // max(image.tool.width, image.tool.height))
    drawn = Image.fromarray(shown).resize(
        (larger * shown.shape[1], larger * shown.shape[0]), Image.Resampling.NEAREST
    )
    pen = ImageDraw.Draw(drawn)
    for name, window in (windows or {}).items():
        box = [larger * each for each in (window.left, window.top, window.right, window.bottom)]
        pen.rectangle(box, outline=FRAME)
        pen.text((box[0] + 3, box[1] + 2), name, fill=FRAME)
    made = io.BytesIO()
    drawn.save(made, "PNG")
    return made.getvalue()


def answered(image: RangeImage) -> str:
    """One line about an image."""
    seen = image.range_m > 0
    size = f"{image.tool.width} x {image.tool.height} pixels"
    if not seen.any():
        return f"{size}, none with an answer"
    kind = "ranges modulo half the wavelength" if image.wrapped else "ranges"
    low, high = (1e3 * float(each) for each in np.percentile(image.range_m[seen], (1, 99)))
    return f"{size}, {seen.mean():.1%} with an answer; {kind} from {low:.1f} to {high:.1f} mm"


def surface_text(found: MeasuredSurface) -> Text:
    """Where the surface at a measurement is, and what of the image told it."""
    where = f" from {found.poses.station}" if found.poses.station else ""
    window = found.window
    size = f"{window.right - window.left} x {window.bottom - window.top} pixels"
    lines = [f"{found.name} with {found.poses.tool}{where}: {answered(found.image)}"]
    lines += _how(found.image)
    lines.append(f"patch of {size}, expected to tell the surface to {_wide(found.expected_m)}")
    if isinstance(found.fit, Fit):
        lines.append(
            f"the surface is {1e3 * found.off_m:+.4f} mm from its nominal place, to {_wide(found.sigma_m)};"
            " where the arm holds the tool is taken as exact"
        )
    else:
        lines.append(f"no surface: {found.fit.reason}")
    return Text("\n".join(lines))


def _wide(sigma_m: float) -> str:
    return f"{1e3 * fits.COVERAGE * sigma_m:.2g} mm"


def surface_content(found: MeasuredSurface) -> dict[str, Any]:
    """The same as plain values, in metres."""
    window = found.window
    return {
        "measurement": found.name,
        "tool": found.poses.tool,
        "station": found.poses.station,
        "patch": [window.left, window.top, window.right, window.bottom],
        "expected_sigma": found.expected_m,
        "answered": float((found.image.range_m > 0).mean()),
        "fit": fits.entry(found.fit),
        **({"off": found.off_m, "sigma": found.sigma_m} if found.sure else {}),
    }


def dimensions_text(
    image: RangeImage, found: Mapping[str, Fitting], between: Mapping[str, tuple[Related, ...]], edges: Edges
) -> Text:
    """An image, fits in it by name, and what is between them, in sentences."""
    counts = [f"{int(edges.on(kind).sum())} on {kind.name.lower()}s" for kind in COLOURS]
    lines = [answered(image), *_how(image), f"pixels at edges: {', '.join(counts)}"]
    for name, each in found.items():
        said = fits.text([each], ()).plain.replace("as far as --noise says", "as far as the image says")
        said = said.replace("times as far as --noise says", "times as far as the image says")
        lines += [f"{name}: {said.splitlines()[0]}", *(f"  {line}" for line in said.splitlines()[1:])]
    for names, related in between.items():
        lines += [f"{names}: {line}" for line in fits.text([], related).plain.splitlines()]
        lines += [f"{names}: nothing can be told between these shapes"] if not related else []
    return Text("\n".join(lines))


def _how(image: RangeImage) -> list[str]:
    """What a depth image does not tell."""
    said = ["strengths are not known: they are taken from distance and slope"] if image.guessed else []
    rounded = f"depths are rounded to {1e3 * image.step_m:.3g} mm: what was rounded alike counts as one value"
    return [*said, *([rounded] if image.step_m else [])]


def dimensions_content(
    image: RangeImage, found: Mapping[str, Fitting], between: Mapping[str, tuple[Related, ...]], edges: Edges
) -> dict[str, Any]:
    """The same as plain values, in metres and radians, in the frame of the tool's eye."""
    return {
        "answered": float((image.range_m > 0).mean()),
        "strength_known": not image.guessed,
        "rounded_to": image.step_m,
        "fits": {name: fits.entry(each) for name, each in found.items()},
        "between": {name: fits.related(each) for name, each in between.items()},
        "edges": {kind.name.lower(): int(edges.on(kind).sum()) for kind in COLOURS},
        "refused": sorted(name for name, each in found.items() if not isinstance(each, Fit)),
    }

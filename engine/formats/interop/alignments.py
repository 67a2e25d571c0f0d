"""Parts aligned by what was measured on them: datums from a problem and the results of a run, and the problem moved accordingly."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwright.engine.formats.interop.depth_files import FARTHEST_M
from cellwright.engine.formats.interop.inspections import rewrite
from cellwright.engine.formats.interop.results import ResultForm, read
from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.fits import Datums
from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.measurement import MeasurementPoint, Triple
from cellwright.engine.pipelines.points import METRES, points
from cellwright.engine.pipelines.verdicts.lying import datum_points, datums, deviation_m
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.loader import domain_of
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.results import Measured, Results
from cellwright.kb.targets import DOMAIN_FILE

HINT = "name the problem that was run, and results that `cellwright results -o` has written"
DOMAIN = re.compile(r"""^(domain:[ \t]*)("[^"\n]*"|'[^'\n]*'|[^#\n]*?)([ \t]*(?:#.*)?)$""", re.MULTILINE)


def read_results(path: Path) -> Results:
    """The results in a file that `cellwright results -o` has written. Raises `InvalidInput`."""
    form = path.suffix[1:].lower()
    if form not in [each.value for each in ResultForm]:
        raise _refused(path, f"'{path.suffix}' is no form of results", "one of .csv, .json, .qif")
    try:
        return read(read_file(path).text, ResultForm(form))
    except ValueError as error:
        raise _refused(path, f"not results: {error}", HINT) from None


def _refused(path: Path, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(path)), "K805", message, hint)])


def datums_of(problem: Problem, results: Results, sigma_m: float) -> Datums:
    """The profiles among the results as datums: those of the alignment's steps, or all if the problem has no such steps.

    A value beyond its nominal value lies that far along the normal. The last value of a point counts. Raises `InvalidInput`.
    """
    known = datum_points(problem)
    last = {each.of: each for each in results.measured if each.of in known}
    if not last:
        raise _refused(Path(problem.path), "the results have no profile of a point of this problem", HINT)
    found = [(known[name], _deviation_m(each, problem)) for name, each in sorted(last.items())]
    return datums(found, [sigma_m] * len(found))


def _deviation_m(measured: Measured, problem: Problem) -> float:
    if measured.unit not in METRES:
        message = f"'{measured.unit}', the unit of {measured.of}, is no length"
        raise _refused(Path(problem.path), message, f"one of {', '.join(METRES)}")
    off_m = deviation_m(measured)
    if abs(off_m) > FARTHEST_M:
        message = f"the value of {measured.of} is farther than {FARTHEST_M:.0f} m from its nominal value"
        raise _refused(Path(problem.path), message, "leave it out of the results")
    return off_m


def write_moved(problem: Problem, T: Floats, target: Path) -> int:
    """Write the problem with all its points displaced by T (4, 4); how many these are. Raises `InvalidInput`.

    A file that is there already is replaced by the whole new text, or kept.
    """
    found = points(problem)
    moved: list[MeasurementPoint | str] = [_moved(point, T) for point in found]
    if target.exists() and target.samefile(problem.path):
        raise _refused(
            target, "this is the problem that was run, and the results belong to it", "name another file"
        )
    copy = target.with_name(f".{target.stem}.moved{target.suffix}")
    try:
        copy.write_text(_settled(problem, copy), "utf-8")
        rewrite(copy, "replaced", moved)
        copy.replace(target)
    finally:
        copy.unlink(missing_ok=True)
    return len(found)


def _settled(problem: Problem, copy: Path) -> str:
    """The text of a problem file for another place; its domain is named so that it is found from there.

    Raises `InvalidInput`.
    """
    source, text = Path(problem.path), read_file(Path(problem.path)).text
    domain = domain_of(str(source)).resolve()
    copy.write_text(text, "utf-8")
    try:
        if domain_of(str(copy)).resolve() == domain:
            return text
    except InvalidInput:
        pass
    near = Path(os.path.relpath(domain.parent, copy.parent.resolve())).as_posix()
    named = near if domain.name == DOMAIN_FILE else f"{near}/{domain.name}"
    return DOMAIN.sub(lambda found: f"{found[1]}{json.dumps(named)}{found[3]}", text, count=1)


def _moved(point: MeasurementPoint, T: Floats) -> MeasurementPoint:
    position = apply(T, np.array([point.position]))[0]
    return replace(point, position=_triple(position), normal=_triple(T[:3, :3] @ np.array(point.normal)))


def _triple(v: Floats) -> Triple:
    return (float(v[0]), float(v[1]), float(v[2]))

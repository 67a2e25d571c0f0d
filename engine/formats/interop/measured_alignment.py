"""Takes datums from results of a run, and writes a copy of the problem with its points moved."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwright.engine.formats.interop.depth_files import MAX_DEPTH_M
from cellwright.engine.formats.interop.inspection_files import edit_measurements
from cellwright.engine.formats.interop.results import ResultForm, read_results_text
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.part_measurements import MeasurementPoint, Triple
from cellwright.engine.model.shape_fits import Datums
from cellwright.engine.pipelines.inspection.measurement_points import (
    METRES_PER_UNIT,
    points_of_problem,
)
from cellwright.engine.pipelines.inspection.part_alignment import (
    datum_points,
    datums_of_points,
    deviation_m,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file
from cellwright.kb.loader import domain_of
from cellwright.kb.model.measured_results import Measured, Results
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.targets import DOMAIN_FILE

RESULTS_HINT = "name the problem that was run, and results that `cellwright results -o` has written"
DOMAIN_LINE = re.compile(
    r"""^(domain:[ \t]*)("[^"\n]*"|'[^'\n]*'|[^#\n]*?)([ \t]*(?:#.*)?)$""", re.MULTILINE
)


def read_results(path: Path) -> Results:
    """The results in a file that `cellwright results -o` has written. Raises `InvalidInput`."""
    form = path.suffix[1:].lower()
    if form not in [result_form.value for result_form in ResultForm]:
        raise _bad_alignment(
            path, f"'{path.suffix}' is no form of results", "one of .csv, .json, .qif"
        )
    try:
        return read_results_text(read_file(path).text, ResultForm(form))
    except ValueError as error:
        raise _bad_alignment(path, f"not results: {error}", RESULTS_HINT) from None


def _bad_alignment(path: Path, message: str, hint: str) -> InvalidInput:
    return InvalidInput([Diagnostic(Source(str(path)), "K805", message, hint)])


def datums_of(problem: Problem, results: Results, sigma_m: float) -> Datums:
    """The profiles among the results as datums: those of the alignment's steps, or all if the
    problem has no such steps.

    A value beyond its nominal value lies that far along the normal. The last value of a point
    counts. Raises `InvalidInput`.
    """
    known = datum_points(problem)
    last = {measured.of: measured for measured in results.measured if measured.of in known}
    if not last:
        raise _bad_alignment(
            Path(problem.path),
            "the results have no profile of a point of this problem",
            RESULTS_HINT,
        )
    measured_datums = [
        (known[name], _deviation_m(measured, problem)) for name, measured in sorted(last.items())
    ]
    return datums_of_points(measured_datums, [sigma_m] * len(measured_datums))


def _deviation_m(measured: Measured, problem: Problem) -> float:
    if measured.unit not in METRES_PER_UNIT:
        message = f"'{measured.unit}', the unit of {measured.of}, is no length"
        raise _bad_alignment(Path(problem.path), message, f"one of {', '.join(METRES_PER_UNIT)}")
    off_m = deviation_m(measured)
    if abs(off_m) > MAX_DEPTH_M:
        message = (
            f"the value of {measured.of} is farther than {MAX_DEPTH_M:.0f} m from its nominal value"
        )
        raise _bad_alignment(Path(problem.path), message, "leave it out of the results")
    return off_m


def write_moved(problem: Problem, T: Floats, target: Path) -> int:
    """Write the problem with all its points displaced by T (4, 4); how many these are. Raises
    `InvalidInput`.

    A file that is there already is replaced by the whole new text, or kept.
    """
    measured_points = points_of_problem(problem)
    moved: list[MeasurementPoint | str] = [_transform_point(point, T) for point in measured_points]
    if target.exists() and target.samefile(problem.path):
        raise _bad_alignment(
            target,
            "this is the problem that was run, and the results belong to it",
            "name another file",
        )
    copy = target.with_name(f".{target.stem}.moved{target.suffix}")
    try:
        copy.write_text(_text_elsewhere(problem, copy), "utf-8")
        edit_measurements(copy, "replaced", moved)
        copy.replace(target)
    finally:
        copy.unlink(missing_ok=True)
    return len(measured_points)


def _text_elsewhere(problem: Problem, copy: Path) -> str:
    """The text of a problem file for another place; its domain is named so that it is found from
    there.

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
    return DOMAIN_LINE.sub(lambda line: f"{line[1]}{json.dumps(named)}{line[3]}", text, count=1)


def _transform_point(point: MeasurementPoint, T: Floats) -> MeasurementPoint:
    position = apply(T, np.array([point.position]))[0]
    return replace(
        point,
        position=_point_triple(position),
        normal=_point_triple(T[:3, :3] @ np.array(point.normal)),
    )


def _point_triple(v: Floats) -> Triple:
    return (float(v[0]), float(v[1]), float(v[2]))

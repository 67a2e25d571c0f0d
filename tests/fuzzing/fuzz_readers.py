"""Every reader of a file or a text that people write, with what it is given and how it is
called.
"""

import json
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path

import fuzz_seeds as seeds

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.files import File, read_file


class Refused(Exception):
    """A reader said no in the way that it promises."""


@dataclass(frozen=True)
class Reader:
    """A reader: the kind of mutation, sound inputs, and a function that reads a file.

    `beside` are files it needs.
    """

    name: str
    kind: str
    seeds: Callable[[], Sequence[bytes]]
    read: Callable[[Path], object]
    file: str = "input"
    beside: dict[str, str] = field(default_factory=dict)


def _text(path: Path) -> str:
    return path.read_bytes().decode(
        "utf-8", "surrogatepass" if _has_surrogates(path) else "replace"
    )


def _has_surrogates(path: Path) -> bool:
    try:
        path.read_bytes().decode("utf-8", "surrogatepass")
    except UnicodeDecodeError:
        return False
    return True


def _said(*texts: str) -> Callable[[], list[bytes]]:
    said = [each.encode() for each in texts]
    return lambda: said


@cache
def _found(pattern: str, *folders: str) -> list[bytes]:
    return seeds.files(pattern, *(seeds.TOP / each for each in folders))


def _of(pattern: str, *folders: str) -> Callable[[], list[bytes]]:
    return lambda: _found(
        pattern, *(folders or ("domains", "tests/data", "tests/domains", "engine/authoring"))
    )


def _words(pattern: str) -> Callable[[], list[bytes]]:
    """The lines of files, each by itself."""
    return cache(
        lambda: [
            line.strip() for text in _of(pattern)() for line in text.split(b"\n") if len(line) > 5
        ][:3000]
    )


def expressions(path: Path) -> None:
    from cellwright.kb.syntax import GRAMMAR_STARTS, ExpressionError, parse_expression

    text, refused = _text(path), 0
    for start in GRAMMAR_STARTS:
        try:
            parse_expression(start, text)
        except ExpressionError as error:
            if not 0 <= error.offset <= len(text):
                raise IndexError(error.offset) from error
            refused += 1
    if refused == len(GRAMMAR_STARTS):
        raise Refused


def terms(path: Path) -> None:
    from cellwright.kb.asp import AspError, ground_term
    from cellwright.kb.plain_terms import plain_terms

    text = _text(path)
    plain_terms(text)
    try:
        ground_term(text)
    except AspError:
        raise Refused from None


def rules(path: Path) -> None:
    from cellwright.kb.asp import AspError
    from cellwright.kb.asp.statements import read_statements

    text = _text(path)
    try:
        list(read_statements(text, File.of("rules.lp", text).line))
    except AspError:
        raise Refused from None


def notation(path: Path) -> None:
    from cellwright.kb.store import term_notation as read

    text, refused = _text(path), 0
    for each in (read.read_term, read.read_stored_atom, read.read_literal, read.read_part):
        try:
            each(text)
        except read.NotationError:
            refused += 1
    if refused == 4:
        raise Refused


def numbers(path: Path) -> None:
    from cellwright.kb.numbers import NumberError, read_decimal, read_whole

    for each in (read_whole, read_decimal):
        try:
            each(_text(path))
        except NumberError:
            continue
        return
    raise Refused


def tree(path: Path) -> None:
    from cellwright.kb.loader.yaml_tree import read_tree

    _, found = read_tree(read_file(path))
    if found:
        raise Refused


def xml(path: Path) -> None:
    from cellwright.kb.loader.strict_xml import read_xml

    read_xml(read_file(path))


def address(path: Path) -> None:
    from cellwright.kb.store.database import store_url as read

    read(_text(path))


def protocol(path: Path) -> None:
    from cellwright.engine.pipelines.execution.controllers import protocol as read

    try:
        found = read.read_line(path.read_bytes())
        what = {"ready": read.read_ready, "send": read.read_commands}
        late = {"reply": read.read_reply, "reports": read.read_reports}
        if found["type"] in what:
            what[found["type"]](found)
        if found["type"] in late:
            late[found["type"]](found, 5)
    except read.MalformedLine:
        raise Refused from None


def macrops(path: Path) -> None:
    from cellwright.engine.pipelines.planning.macros.macro_exchange import (
        macro_records,
        read_macros,
    )

    macro_records(read_macros(path))


def cases(path: Path) -> None:
    from cellwright.engine.pipelines.recovery.case_input import import_counts

    import_counts(_fault_model(), path)


@cache
def _fault_model():  # type: ignore[no-untyped-def]
    from cellwright.kb.loader.fault_base import load_faults

    return load_faults(seeds.CELLS[0] / "domain.yaml")[0]


@cache
def _cases() -> list[bytes]:
    counts = {
        name: dict.fromkeys(each.counts, 2.5) for name, each in _fault_model().exceptions.items()
    }
    return [json.dumps(counts).encode()]


def motions(path: Path) -> None:
    from cellwright.engine.faces.cli.verbs.motion_verbs import _read_problem_set

    _read_problem_set(path)


def results(form: str, path: Path) -> None:
    from cellwright.engine.formats.interop.results import ResultForm, read_results_text

    try:
        read_results_text(read_file(path).text, ResultForm(form))
    except ValueError as error:
        raise Refused from error


@cache
def _results(form: str) -> list[bytes]:
    from cellwright.engine.formats.interop.results import ResultForm, write_results
    from cellwright.kb.model.measured_results import Measured, Results

    measured = Measured(
        "m1", "thickness", 6342.5, "um", 6350, 6340, 6360, "probe", "measure(m1)", 42_000
    )
    return [
        write_results(
            Results("monday", "2026-11-22T10:00:00+00:00", (measured,)), ResultForm(form)
        ).encode()
    ]


def log(path: Path) -> None:
    from cellwright.engine.pipelines.simulators.simulator_log import SimulatorLog

    with closing(SimulatorLog(str(path))) as found:
        list(found.past())


def sentence(path: Path) -> None:
    from cellwright.kb.commands import understand_command

    understand_command(_domain(), _text(path))


@cache
def _domain():  # type: ignore[no-untyped-def]
    from cellwright.kb.loader import load_domain

    return load_domain("themse")


def goals(path: Path) -> None:
    from cellwright.kb.loader import with_goals

    with_goals(_domain(), _text(path))


def configuration(path: Path) -> None:
    from cellwright.kb.loader.joint_values import read_configuration

    read_configuration(_text(path), _cell())


@cache
def _cell():  # type: ignore[no-untyped-def]
    from cellwright.kb.loader.cell import load_cell

    return load_cell(seeds.CELLS[1] / "cell.yaml")


def urdf(path: Path) -> None:
    from cellwright.kb.loader.cell import load_cell

    load_cell(path.with_name("cell.yaml"))


def cell(path: Path) -> None:
    from cellwright.kb.loader.cell import load_cell

    load_cell(path)


def arm(path: Path) -> None:
    from cellwright.kb.loader.arm_file import load_arm

    load_arm(path)


def scene(path: Path) -> None:
    from cellwright.kb.loader.scene_file import load_scene

    load_scene(path)


def mesh(path: Path) -> None:
    from cellwright.engine.stages.geometry.shapes.meshes import read_mesh

    read_mesh(path)


def depth(path: Path) -> None:
    from cellwright.engine.formats.interop.depth_files import read_depth
    from cellwright.engine.model.vision import DepthCamera

    read_depth(path, DepthCamera.viewing(8, 6, 0.6, 1.0))


def qif(path: Path) -> None:
    from cellwright.engine.formats.interop.qif.feature_points import inspection_of

    inspection_of(path)


def pnml(path: Path) -> None:
    from cellwright.engine.formats.interop.pnml import read_pnml

    read_pnml(path)


def tsplib(path: Path) -> None:
    from cellwright.engine.formats.interop.visit_files import read_tsplib

    read_tsplib(path)


def table(path: Path) -> None:
    from cellwright.engine.formats.interop.measurement_tables import read_table

    read_table(path)


def jobshop(path: Path) -> None:
    from cellwright.engine.formats.interop.shop_files import read_jobshop

    read_jobshop(path)


def slab(path: Path) -> None:
    from cellwright.engine.formats.interop.shop_files import read_slab

    read_slab(path.parent)


def pddl(path: Path) -> None:
    from cellwright.engine.formats.interop.pddl import read_pddl_task

    read_pddl_task(path.with_name("domain.pddl"), path.with_name("problem.pddl"))


def pddl_plan(path: Path) -> None:
    from cellwright.engine.formats.interop.pddl.competition_plans import read_plan

    read_plan(_task(), path)


@cache
def _task():  # type: ignore[no-untyped-def]
    import tempfile

    from cellwright.engine.formats.interop.pddl import read_pddl_task

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "d.pddl").write_text(seeds.PDDL_DOMAIN)
        (folder / "p.pddl").write_text(seeds.PDDL_PROBLEM)
        return read_pddl_task(folder / "d.pddl", folder / "p.pddl")


def plan(path: Path) -> None:
    from cellwright.kb.loader import load_plan

    load_plan(path)


SLAB_FILES = {f"{name}.tsv": text for name, text in seeds.SLAB.items()}
PDDL_FILES = {"domain.pddl": seeds.PDDL_DOMAIN, "problem.pddl": seeds.PDDL_PROBLEM}
FILES = [
    Reader("expression", "text", _words("*.yaml"), expressions),
    Reader("term", "text", _said("f(a, 1)", 'g(f(a), "x", -3)', "p(1 + 2 * 3)"), terms),
    Reader("rules", "text", _of("*.lp"), rules, "rules.lp"),
    Reader(
        "notation",
        "text",
        _said("at(arm, X)", 'not p(f(-1), "a")', "X != Y + 2 * 3", "f(g(h(1)))"),
        notation,
    ),
    Reader("number", "text", _said("1", "-2.5e3", ".5", "0012", "1e15"), numbers),
    Reader("YAML tree", "yaml", _of("*.yaml"), tree),
    Reader("XML", "xml", _said(seeds.PNML, seeds.QIF, seeds.URDF), xml),
    Reader(
        "store address",
        "text",
        _said("a/b.db", "postgresql://u:p@host:5432/d?x=1", "sqlite:///a.db", "~x/y"),
        address,
    ),
    Reader("controller", "json", _said(*seeds.PROTOCOL), protocol),
    Reader("MACROPs", "json", _said(seeds.MACROPS), macrops, "macrops.json"),
    Reader("closed cases", "json", _cases, cases, "cases.json"),
    Reader("motion set", "json", _said(seeds.MOTIONS), motions, "set.json"),
    Reader("simulator log", "text", _said(seeds.LOG), log, "log.jsonl"),
    Reader("command", "text", _said(*seeds.SENTENCES), sentence),
    Reader(
        "goals",
        "text",
        _said("stored(probe_1), not open(flap)", "forall(X: probe): stored(X)"),
        goals,
    ),
    Reader("configuration", "text", _said(*seeds.CONFIGURATIONS), configuration),
    Reader("URDF", "xml", _said(seeds.URDF), urdf, "arm.urdf", {"cell.yaml": seeds.URDF_CELL}),
    Reader("cell", "yaml", _of("cell.yaml"), cell, "cell.yaml"),
    Reader("arm", "yaml", _of("*.yaml", "kb/arms"), arm, "arm.yaml"),
    Reader(
        "scene",
        "yaml",
        _of("scene.yaml"),
        scene,
        "scene.yaml",
        {"cell.yaml": (seeds.TOP / "domains" / "handey" / "cell.yaml").read_text("utf-8")},
    ),
    Reader("STL", "bytes", lambda: [seeds.stl(), seeds.STL.encode()], mesh, "a.stl"),
    Reader("OBJ", "text", _said(seeds.OBJ), mesh, "a.obj"),
    Reader("PLY mesh", "bytes", lambda: [seeds.ply()], mesh, "a.ply"),
    Reader("OFF", "text", _said(seeds.OFF), mesh, "a.off"),
    Reader("depth NPY", "bytes", lambda: [seeds.npy()], depth, "a.npy"),
    Reader("depth PNG", "bytes", lambda: [seeds.png()], depth, "a.png"),
    Reader("depth PCD", "text", _said(seeds.PCD), depth, "a.pcd"),
    Reader("depth PLY", "bytes", lambda: [seeds.ply()], depth, "a.ply"),
    Reader("QIF", "xml", _said(seeds.QIF), qif, "part.qif"),
    Reader("PNML", "xml", _said(seeds.PNML), pnml, "net.pnml"),
    Reader("TSPLIB", "text", _said(seeds.TSPLIB, seeds.EXPLICIT), tsplib, "a.tsp"),
    Reader("table", "text", _said(seeds.TABLE), table, "points.csv"),
    Reader("job shop", "text", _said(*seeds.SHOPS), jobshop, "shop.txt"),
    *(
        Reader(f"S-LAB {name}", "text", _said(text), slab, f"{name}.tsv", SLAB_FILES)
        for name, text in seeds.SLAB.items()
    ),
    Reader("PDDL domain", "text", _said(seeds.PDDL_DOMAIN), pddl, "domain.pddl", PDDL_FILES),
    Reader("PDDL problem", "text", _said(seeds.PDDL_PROBLEM), pddl, "problem.pddl", PDDL_FILES),
    Reader("PDDL plan", "text", _said(seeds.PDDL_PLAN), pddl_plan, "plan.txt"),
    *(
        Reader(
            f"results {form}",
            "text",
            partial(_results, form),
            partial(results, form),
            f"results.{form}",
        )
        for form in ("csv", "json", "qif")
    ),
    Reader("plan", "json", _of("*.json", "domains"), plan, "plan.json"),
]
REFUSALS = (Refused, InvalidInput)

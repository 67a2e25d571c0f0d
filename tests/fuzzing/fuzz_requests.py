"""Readers of what people and programs ask of commands, of runs, and of the monitor; and of
formats with numbers and curves.
"""

import asyncio
import json
from collections.abc import Callable, MutableMapping
from contextlib import suppress
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import fuzz_seeds as seeds
from fuzz_measured import MEASURED
from fuzz_readers import FILES, Reader, Refused, _said, _text, mesh, pddl, qif, urdf

NUMBERS_DOMAIN = """(define (domain pumps)
  (:requirements :typing :numeric-fluents)
  (:types tank pump)
  (:predicates (open ?p - pump))
  (:functions (level ?t - tank) (portion ?p - pump) (energy))
  (:action fill :parameters (?t - tank ?p - pump)
    :precondition (and (open ?p) (<= (+ (level ?t) (* 0.5 (portion ?p))) 2.5))
    :effect (and (increase (level ?t) (* 0.5 (portion ?p))) (increase (energy) 0.25)))
  (:action drain :parameters (?t - tank) :precondition (>= (level ?t) 0.75) :effect (decrease (level ?t) 0.75)))
"""
NUMBERS_PROBLEM = """(define (problem p) (:domain pumps) (:objects a b - tank quick - pump)
  (:init (= (level a) 0) (= (level b) 1.25) (= (portion quick) 1) (open quick) (= (energy) 0))
  (:goal (and (> (level a) (* 2 (level b))) (>= (level a) 1))) (:metric minimize (energy)))
"""
NUMBERS = {"domain.pddl": NUMBERS_DOMAIN, "problem.pddl": NUMBERS_PROBLEM}
ACTS = (
    '[{"joints": [0, -90, 90, 0, 90, 0], "jaws": "close"}, {"body": "wheel", "at": [0.4, 0, '
    '0.1], "rpy": [0, 0, 90]}]'
)
REQUEST = json.dumps(
    {
        "kind": "http",
        "method": "POST",
        "query": "token=a",
        "headers": {
            "host": "127.0.0.1:8210",
            "origin": "http://127.0.0.1:8210",
            "cookie": "cellwright_token=a",
            "x-cellwright-token": "a",
        },
    }
)
ORDERS = (
    '{"run": "one_1", "order": "skip", "text": "pick(probe_1)", "who": "Ada"}',
    '{"order": "work", "text": "prepare themse --jobs 1"}',
    '{"order": "start", "target": "themse/one", "seed": 3, "fault": "pick=not_gripped", '
    '"approve": true}',
)
SRDF = '<robot name="arm"><disable_collisions link1="base" link2="hand" reason="Never"/></robot>'
SRDF_CELL = "cell: bench\narms:\n  left: {urdf: arm.urdf, srdf: arm.srdf, chain: [base, hand]}\n"
DAE = """<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit meter="0.001"/>
<up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="9">
0 0 0 1 0 0 0 1 0</float_array><technique_common><accessor source="#a" count="3" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source><vertices id="v">
<input semantic="POSITION" source="#p"/></vertices><triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p>
</triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/>
</node></visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty "
    "float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 "
    "0 1 2\n"
)
STEP = {
    "id": 1,
    "step": "pick(probe_1)",
    "stream": "arm",
    "expects": "done",
    "lasts_ms": 10,
    "after": [],
    "adds": [],
    "deletes": [],
}
JOURNAL = (
    {
        "command": 1,
        "action": "pick(probe_1)",
        "started_ms": 0,
        "adds": ["held(probe_1)"],
        "events": [],
    },
    {"command": 2, "text": "measured(12)", "values": {"thickness": "12.5"}},
    {"steps": [STEP], "dwells": [[1, 2, 0, 5]], "timed": True, "order": [1], "hands": ["arm"]},
)


def acts(path: Path) -> None:
    from cellwright.engine.formats.interop.operator_events import read_acts

    read_acts(path, _scene())


@cache
def _scene():  # type: ignore[no-untyped-def]
    from cellwright.kb.loader.scene_file import load_scene

    return load_scene(seeds.TOP / "domains" / "handey" / "scenes" / "turning.yaml")


@cache
def _problem():  # type: ignore[no-untyped-def]
    from cellwright.engine.pipelines.planning.checked_plan import problem_of

    return problem_of("themse/one")


def addition(path: Path) -> None:
    from cellwright.engine.pipelines.execution.run_goals import extend_problem
    from cellwright.engine.pipelines.execution.run_goals import read_addition as read

    found = read(_problem(), _text(path), 1000)
    extend_problem(_problem(), found.words, found.wishes)


def facts(path: Path) -> None:
    from cellwright.engine.pipelines.recovery.observations import read_facts

    read_facts(_text(path), _problem().domain, "--holds")


def steps(path: Path) -> None:
    from cellwright.engine.pipelines.recovery.observations import read_steps
    from cellwright.kb.model.plan_model import StepId

    read_steps(_text(path), map(StepId, range(1, 20)))


def settings(path: Path) -> None:
    from cellwright.engine.pipelines.execution.controllers.link import patience_of, place_of
    from cellwright.engine.pipelines.simulators.simulator_settings import settings_of
    from cellwright.engine.ports import DriverSetup
    from cellwright.kb.diagnostics import InvalidInput

    options = dict(line.split("=", 1) for line in _text(path).split("\n") if "=" in line)
    for each in (
        place_of,
        patience_of,
        lambda given: settings_of(DriverSetup(_problem(), "r", 0, 0.0, given)),
    ):
        with suppress(InvalidInput):
            each(options)


def request(path: Path) -> None:
    from cellwright.engine.faces.monitor.access_control import AccessControl

    asked = _object(path)
    headers = asked.get("headers")
    named = headers.items() if isinstance(headers, dict) else ()
    scope = {
        "type": "websocket" if asked.get("kind") == "websocket" else "http",
        "method": str(asked.get("method")),
        "query_string": str(asked.get("query")).encode("utf-8", "replace"),
        "headers": [(str(name).encode("utf-8", "replace"), _bytes(value)) for name, value in named],
    }

    async def inner(_scope: object, _receive: object, send: Callable[..., Any]) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive() -> MutableMapping[str, Any]:
        return {"type": "websocket.connect"}

    async def send(message: MutableMapping[str, Any]) -> None:
        said.append(message)

    said = list[MutableMapping[str, Any]]()
    for local in (True, False):
        asyncio.run(AccessControl(inner, ["127.0.0.1:8210"], "a", local)(scope, receive, send))
    if said[0].get("status", 200) != 200:
        raise Refused


def _bytes(value: object) -> bytes:
    return str(value).encode("utf-8", "replace")


def _object(path: Path) -> dict[str, Any]:
    """The object in a file, as the monitor reads the body of a request."""
    from cellwright.kb.json_text import parse_json

    try:
        found = parse_json(path.read_bytes())
    except ValueError:
        raise Refused from None
    if not isinstance(found, dict):
        raise Refused
    return found


def order(path: Path) -> None:
    from cellwright.engine.faces.monitor import shared_state

    shared_state.start_run = lambda *_: "not here"  # nothing is started
    shared_state.start_command = lambda *_: None  # type: ignore[assignment,return-value]
    status, _ = shared_state.SharedState(str(path.with_name("runs.db"))).order("key", _object(path))
    if status != 200:
        raise Refused


def journal(path: Path) -> None:
    """A line of a journal whose content was changed: results are read from it, and a run is
    resumed from it.
    """
    from cellwright.engine.pipelines.execution.plan_records import compiled_of
    from cellwright.engine.pipelines.execution.record_shapes import read_record
    from cellwright.engine.pipelines.execution.run_journal import reading_past
    from cellwright.engine.pipelines.execution.run_results import read_run_results
    from cellwright.kb.diagnostics import InvalidInput
    from cellwright.kb.store.journal import Begun, JournalLine

    content, refused = _object(path), 0
    for take in (
        lambda: read_run_results(
            Begun("r", "", {}), _problem(), [read_record(JournalLine(1, 0, "reply", content))]
        ),
        lambda: read_run_results(
            Begun("r", "", {}), _problem(), [read_record(JournalLine(1, 0, "done", content))]
        ),
        lambda: compiled_of(read_record(JournalLine(1, 0, "plan", content)).content),
    ):
        try:
            with reading_past("store", "r"):
                take()
        except InvalidInput:
            refused += 1
    if refused == 3:
        raise Refused


def rewritten(path: Path) -> None:
    """A problem file from which a measurement is taken out."""
    from cellwright.engine.formats.interop.inspection_files import edit_measurements

    edit_measurements(path, "removed", "a1")


@cache
def curved() -> list[bytes]:
    """A QIF part whose face is bounded by a polyline in space and in parameters."""
    from tempfile import TemporaryDirectory

    from tests.engine.formats.interop.qif_parts import Document, plane, polyline, segment

    document = Document()
    corners = [(0, 0, 0), (40, 0, 0), (40, 30, 0), (0, 30, 0), (0, 0, 0)]
    edges = [
        document.coedge(segment(a, b), (a, b), segment(a[:2], b[:2]))[0]
        for a, b in pairwise(corners)
    ]
    ring = polyline([(10, 10, 0), (10, 20, 0), (20, 20, 0), (10, 10, 0)])
    inner = document.coedge(ring, ((10, 10, 0), (10, 10, 0)))[0]
    face = document.face(plane(), [document.loop(edges), document.loop([inner], "INNER")])
    document.feature("Plane", [face])
    with TemporaryDirectory() as name:
        return [document.written(Path(name)).read_bytes()]


PROBLEM = (seeds.TOP / "domains" / "bulkhead" / "problems" / "three_stations.yaml").read_bytes()
PARSERS = [
    *FILES,
    *MEASURED,
    Reader("PDDL numbers, domain", "text", _said(NUMBERS_DOMAIN), pddl, "domain.pddl", NUMBERS),
    Reader("PDDL numbers, problem", "text", _said(NUMBERS_PROBLEM), pddl, "problem.pddl", NUMBERS),
    Reader("QIF curves", "xml", curved, qif, "part.qif"),
    Reader(
        "SRDF",
        "xml",
        _said(SRDF),
        urdf,
        "arm.srdf",
        {"cell.yaml": SRDF_CELL, "arm.urdf": seeds.URDF},
    ),
    Reader("DAE", "xml", _said(DAE), mesh, "a.dae"),
    Reader("PLY mesh with faces", "text", _said(PLY), mesh, "a.ply"),
    Reader("acts", "json", _said(ACTS), acts, "acts.json"),
    Reader(
        "addition",
        "text",
        _said("due(probe_1, 40 min); priority(probe_1, 3)", "store probe 1"),
        addition,
    ),
    Reader(
        "seen facts",
        "text",
        _said("open(drawer), empty(arm)", "location(probe_1, slot(drawer, 1))"),
        facts,
    ),
    Reader("done steps", "text", _said("1..4, 7", "2", "1, 2, 3..9"), steps),
    Reader(
        "driver options",
        "text",
        _said(
            "spread=0.2\nlookahead=4\nfault=pick#2=arm_offset@lost",
            "address=host:80\nanswer=5\nheartbeat=1e3",
        ),
        settings,
    ),
    Reader("monitor request", "json", _said(REQUEST), request, "request.json"),
    Reader("monitor order", "json", _said(*ORDERS), order, "order.json"),
    Reader("journal", "json", _said(*map(json.dumps, JOURNAL)), journal, "line.json"),
    Reader("rewritten problem", "yaml", lambda: [PROBLEM], rewritten, "problem.yaml"),
]

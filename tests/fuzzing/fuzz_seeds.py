"""Small sound files of each format, from which mutations begin."""

import io
import json
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing

TOP = Path(__file__).parents[2]
CELLS = [
    TOP / "domains" / "themse",
    TOP / "domains" / "bulkhead",
    TOP / "engine" / "authoring" / "starter" / "cell",
]
CELLS += sorted(path.parent for path in (TOP / "tests" / "domains").glob("*/domain.yaml"))
LARGEST = 30_000  # bytes: mutations of larger files mostly change what does not matter

PNML = """<pnml xmlns="http://www.pnml.org/version-2009/grammar/pnml">
<net id="n" type="http://www.pnml.org/version-2009/grammar/ptnet"><page id="g"><page id="inner">
<place id="p"><name><text>free</text></name><initialMarking><graphics/><text> 2 </text></initialMarking></place></page>
<transition id="t"><name><text>go</text></name></transition><arc id="a" source="p" target="t">
<inscription><text>1</text></inscription></arc><arc id="b" source="t" target="p"/></page></net></pnml>"""
TSPLIB = """NAME : plate
TYPE : TSP
DIMENSION : 4
EDGE_WEIGHT_TYPE : EUC_2D
NODE_COORD_SECTION
1 0 0
2 3 4
3 6 0
4 3.5 -1e1
EOF
"""
EXPLICIT = """NAME : table
TYPE : ATSP
DIMENSION : 3
EDGE_WEIGHT_TYPE : EXPLICIT
EDGE_WEIGHT_FORMAT : FULL_MATRIX
EDGE_WEIGHT_SECTION
0 3 4 5 0 6 7 8 0
EOF
"""
TABLE = "name,x,y,z,nx,ny,nz,kind,nominal,tolerance\nm1,10,20,0,0,0,1,thickness,5,0.1\nm2,1,2,3,0,1,0,profile,,0.05\n"
SHOPS = [
    "2 2\n0 3 1 4\n1 2 0 1\n",
    '{"duration_matrix": [[3, 4], [1, 2]], "machines_matrix": [[0, 1], [1, 0]]}',
]
SLAB = {
    "machines": "No\tType\tName\n1\t1\tshaker A\n2\t1\tshaker B\n3\t2\treader\n",
    "operations": "Job\tOp\tMachine\tTime\tNote\n1\t1\t1\t5\tshake\n1\t2\t2\t3\tread\n2\t1\t1\t5\tshake\n",
    "dependency": "Job\tA\tB\n1\t1\t2\n\t\t\n",
    "tcmb": "Job\tA\tPoint\tB\tPoint\tTime\n1\t1\tend\t2\tstart\t1\n",
}
PDDL_DOMAIN = """(define (domain workshop)
  (:requirements :strips :typing :action-costs :negative-preconditions)
  (:types item place)
  (:constants bin - place)
  (:predicates (at ?i - item ?p - place) (free ?p - place))
  (:functions (total-cost) (way ?a - place ?b - place))
  (:action move
    :parameters (?i - item ?from - place ?to - place)
    :precondition (and (at ?i ?from) (free ?to) (not (at ?i ?to)))
    :effect (and (not (at ?i ?from)) (at ?i ?to) (free ?from) (increase (total-cost) (way ?from ?to)))))
"""
PDDL_PROBLEM = """(define (problem tidy) (:domain workshop)
  (:objects bolt nut - item shelf - place)
  (:init (at bolt bin) (free shelf) (= (way bin shelf) 3) (= (way shelf bin) 4) (= (total-cost) 0))
  (:goal (and (at bolt shelf))) (:metric minimize (total-cost)))
"""
PDDL_PLAN = "(move bolt bin shelf)\n; cost = 3 (general cost)\n"
QIF = """<?xml version="1.0"?><QIFDocument xmlns="http://qifstandards.org/xsd/qif3" versionQIF="3.0.0"><FileUnits><PrimaryUnits>
<LinearUnit><UnitName>mm</UnitName><UnitConversion><Factor>0.001</Factor></UnitConversion></LinearUnit></PrimaryUnits></FileUnits>
<Features><FeatureDefinitions>
<CylinderFeatureDefinition id="1"><InternalExternal>INTERNAL</InternalExternal><Diameter>20</Diameter><Length>40</Length>
</CylinderFeatureDefinition><PlaneFeatureDefinition id="2"/><LineFeatureDefinition id="5"/>
<ConeFeatureDefinition id="4"><InternalExternal>EXTERNAL</InternalExternal><Diameter>10</Diameter>
<HalfAngle>0.5</HalfAngle><LargeEndDistance>8</LargeEndDistance><SmallEndDistance>2</SmallEndDistance></ConeFeatureDefinition>
</FeatureDefinitions><FeatureNominals>
<CylinderFeatureNominal id="11"><FeatureDefinitionId>1</FeatureDefinitionId>
<Axis><AxisPoint>1 2 3</AxisPoint><Direction>0 0 1</Direction></Axis></CylinderFeatureNominal>
<PlaneFeatureNominal id="12"><FeatureDefinitionId>2</FeatureDefinitionId><Location>0 0 5</Location><Normal>0 0 1</Normal>
<PolyLine count="4">0 0 5 100 0 5 100 100 5 0 100 5</PolyLine></PlaneFeatureNominal>
<ConeFeatureNominal id="14"><FeatureDefinitionId>4</FeatureDefinitionId>
<Axis><AxisPoint>0 0 0</AxisPoint><Direction>1 0 0</Direction></Axis></ConeFeatureNominal>
<LineFeatureNominal id="15"><FeatureDefinitionId>5</FeatureDefinitionId><Location>0 0 0</Location>
<Direction>0 1 0</Direction><Length>50</Length></LineFeatureNominal>
</FeatureNominals></Features></QIFDocument>"""
URDF = """<robot name="arm"><link name="base"/><link name="one"><collision><origin xyz="0 0 0.1"/><geometry>
<cylinder radius="0.05" length="0.2"/></geometry></collision></link><link name="hand"><collision><geometry><box size="0.1 0.1 0.1"/>
</geometry></collision></link>
<joint name="a" type="revolute"><parent link="base"/><child link="one"/><origin xyz="0 0 0.2" rpy="0 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1"/></joint>
<joint name="b" type="prismatic"><parent link="one"/><child link="hand"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.5" velocity="0.2"/></joint></robot>"""
URDF_CELL = "cell: bench\narms:\n  left: {urdf: arm.urdf, chain: [base, hand]}\n"
STL = (
    "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 "
    "0\nendloop\nendfacet\nendsolid a\n"
)
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
OFF = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
PCD = (
    "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH "
    "3\nHEIGHT 1\n"
    "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA ascii\n0 0 1\n0.1 0 1\n0 0.1 1.1\n"
)
RESULTS_CSV = "\ufeff" + "run,started\n"
MOTIONS = (
    '{"problems": [{"from": "home", "to": "0, 90, 0, 0, 0, 0"}, {"from": "home", "to": '
    '"meas(m2)", "answer": {"a": 1}}]}'
)
LOG = (
    """{"at_ms": 0, "sent": [{"number": 1, "kind": "step", "stream": "arm", "action": "pick(a)", "expects": "done", "choices": [],
"lasts_ms": 10, "about": null}]}""".replace("\n", " ")
    + '\n{"at_ms": 10, "ended": 1, "action": "pick(a)", "reply": "done"}\n{"at_ms": 12, '
    '"halted": true}\n'
)
PROTOCOL = [
    '{"type": "ready", "version": 1, "name": "cell", "now_ms": 0, "virtual": true, "tick_ms": '
    '5, "lookahead": {"arm": 2}}',
    '{"type": "reply", "number": 3, "text": "done", "at_ms": 10, "values": {"thickness": "12.5"}}',
    '{"type": "reports", "reports": [{"number": 1, "fate": "done", "reply": {"number": 1, '
    '"text": "done", "at_ms": 3}}]}',
    '{"type": "send", "commands": [{"number": 1, "kind": "step", "stream": "arm", "action": '
    '"pick(a)", "expects": "done", '
    '"choices": [], "lasts_ms": 10, "about": ""}]}',
]
MACROPS = json.dumps(
    {
        "version": 1,
        "macrops": [
            {
                "macrop": "go(X)",
                "domain": "bulkhead",
                "goals": ["at(arm, X)"],
                "preconditions": ["at(arm, Y)", "not busy(arm)"],
                "adders": ["at(arm, X)"],
                "unary constraints": {"X": ["point"], "Y": ["point"]},
                "n-ary constraints": ["X != Y", "way(X, Y)"],
                "resources": ["arm"],
                "plan": [
                    {"id": 1, "operator": "move(arm, Y, X)", "duration": "10", "cost": "(1 + 2)"}
                ],
                "links": [[0, "at(arm, Y)", 1]],
                "depends": {"operator move": "0123456789abcdef"},
            }
        ],
    }
)
SENTENCES = [
    "process probes 1 and 2 in the furnace for 15 min, cool them down in the freezer for 5 min "
    "and store them in the drawer again",
    "heat probe 1 for 5 min before storing it, then close the flap",
    "open the drawer and the flap",
]
CONFIGURATIONS = ["0, 90, 0, 0, 0, 0", "arm: 0 deg, 1.5 rad, 0, 0, 0, 10 mm"]


def stl() -> bytes:
    """A triangle in the binary form of STL."""
    return (
        b"\0" * 80
        + struct.pack("<I", 1)
        + struct.pack("<12fH", *([0.0] * 3), *map(float, range(9)), 0)
    )


def ply() -> bytes:
    """Points in the binary form of PLY."""
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    return head + b"end_header\n" + struct.pack("<6f", 0, 0, 1, 0.1, 0, 1)


def npy(depths: "np.typing.ArrayLike | None" = None) -> bytes:
    """Depths in NumPy's form; of a plane, if none are given."""
    import numpy as np

    out = io.BytesIO()
    np.save(out, np.ones((6, 8)) if depths is None else np.asarray(depths))
    return out.getvalue()


def png() -> bytes:
    """Depths in millimetres as PNG."""
    import numpy as np
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(np.full((6, 8), 1000, np.uint16)).save(out, "PNG")
    return out.getvalue()


def files(pattern: str, *folders: Path) -> list[bytes]:
    """All files of a kind below some folders, in order, without very large ones."""
    found: Iterable[Path] = (path for folder in folders for path in sorted(folder.rglob(pattern)))
    return [data for path in found if path.is_file() and len(data := path.read_bytes()) <= LARGEST]

"""The datums of a QIF document are measured first, in the order of their precedence."""

import shutil
from pathlib import Path

import pytest

from cellwright.engine.formats.interop.inspection_files import import_file
from cellwright.engine.formats.interop.qif.feature_points import inspection_of
from cellwright.engine.model.tour_problem import Tour
from cellwright.engine.pipelines.inspection.tool_tours import partition_by_tool, tour_problem
from cellwright.engine.stages.sequencing import TourLimits, sequence_tour
from cellwright.kb.loader import load
from tests.engine.formats.interop.qif_parts import Document, plane, segment
from tests.places import BUNDLED

SQUARE = [(0, 0, 0), (50, 0, 0), (50, 50, 0), (0, 50, 0)]


def squares(document: Document, count: int) -> list[str]:
    """Features of one plane square each; the document has them along x."""
    found = []
    for number in range(count):
        corners = [(x + 100 * number, y, z) for x, y, z in SQUARE]
        edges = [
            document.coedge(segment(a, b), (a, b))[0]
            for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
        ]
        found.append(document.feature("Plane", [document.face(plane(), [document.loop(edges)])]))
    return found


def datum(document: Document, label: str, features: list[str]) -> str:
    ids = "".join(f"<Id>{each[1:]}</Id>" for each in features)
    return document.add(
        "DatumDefinitions",
        "<DatumDefinition "
        f'id="{{id}}"><DatumLabel>{label}</DatumLabel><FeatureNominalIds>{ids}</FeatureNominalIds>'
        "</DatumDefinition>",
    )


def frame(document: Document, datums: list[str]) -> None:
    texts = [
        f"<Datum><SimpleDatum><DatumDefinitionId>{each}</DatumDefinitionId></SimpleDatum><Precedence><PrecedenceEnum>"
        f"{name}</PrecedenceEnum></Precedence></Datum>"
        for each, name in zip(datums, ("PRIMARY", "SECONDARY", "TERTIARY"), strict=False)
    ]
    document.add(
        "DatumReferenceFrames",
        f'<DatumReferenceFrame id="{{id}}"><Datums>{"".join(texts)}</Datums></DatumReferenceFrame>',
    )


@pytest.mark.parametrize("framed", [True, False])
def test_datums_come_first_in_their_order(tmp_path: Path, framed: bool) -> None:
    document = Document()
    names = squares(document, 6)
    datums = [datum(document, label, [names[at]]) for label, at in (("A", 3), ("B", 0), ("C", 5))]
    if framed:
        frame(document, datums)
        frame(document, datums[1:2] + datums[:1] + datums[2:])  # B comes first here, too
    found = inspection_of(document.written(tmp_path))
    steps = {each.feature: each.step for each in found.points}
    wanted = {names[3]: 1, names[0]: 1 if framed else 2, names[5]: 2 if framed else 3}
    assert steps == {name: wanted.get(name, 0) for name in names}


def test_the_sequence_of_an_imported_part_keeps_the_alignment(tmp_path: Path) -> None:
    document = Document()
    names = squares(document, 6)
    frame(
        document,
        [datum(document, label, [names[at]]) for label, at in (("A", 3), ("B", 0), ("C", 5))],
    )
    file = tmp_path / "problem.yaml"
    file.write_text(import_file(document.written(tmp_path), "bulkhead")[2])
    problem = load(file).problem
    assert problem is not None
    asked = tour_problem(problem, partition_by_tool(problem))
    found = sequence_tour(asked, TourLimits(work=20))
    assert isinstance(found, Tour)
    features = list(dict.fromkeys(asked.visits[each].name.split("_")[0] for each in found.order))
    assert features[:3] == [names[3], names[0], names[5]]


def test_what_no_tool_can_measure_is_no_step_of_the_alignment(tmp_path: Path) -> None:
    document = Document()
    names = squares(document, 2)
    frame(document, [datum(document, "A", [names[0]])])
    file = document.written(tmp_path)
    assert "alignment(" in import_file(file, "bulkhead")[2]
    _, parts, text = import_file(file, _without_laser(tmp_path))
    assert not parts.groups
    assert "alignment(" not in text


def _without_laser(folder: Path) -> str:
    target = folder / "other"
    shutil.copytree(BUNDLED / "bulkhead", target)
    rules = target / "rules.lp"
    rules.write_text(rules.read_text() + "unavailable(slra).\n")
    return str(target)

"""Results as CSV, JSON and QIF: read back equal, and QIF as its schema wants it."""

import os
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.formats.interop.results import ResultForm, read_results_text, write_results
from cellwright.kb.model.measured_results import Measured, Results, Treated

SCHEMA = (
    Path(os.environ.get("CELLWRIGHT_DATA", "../shared/data"))
    / "qif/xsd/QIFApplications/QIFDocument.xsd"
)
SPACE = "{http://qifstandards.org/xsd/qif3}"
TEXTS = st.text("ab1 ,;\"'<>&=()éß∅\n", max_size=8)
NUMBERS = st.floats(-1e9, 1e9) | st.integers(-1000, 1000).map(float)
MAYBE = st.none() | NUMBERS
MEASURED = st.builds(
    Measured, TEXTS, TEXTS, NUMBERS, st.sampled_from(["um", "mm", "g", "N "
    "cm"]), MAYBE, MAYBE, MAYBE, TEXTS, TEXTS,
    st.integers(0, 10**9), st.none() | st.floats(0, 1e6), st.none() | st.integers(1, 49).map(float),
)  # fmt: skip
TREATED = st.builds(
    Treated,
    TEXTS,
    TEXTS,
    st.integers(0, 99),
    st.integers(0, 99),
    st.lists(TEXTS, max_size=2).map(tuple),
)
STARTED = st.sampled_from(["", "2026-11-22T10:00:00+00:00"])
RESULTS = st.builds(
    Results,
    TEXTS,
    STARTED,
    st.lists(MEASURED, max_size=3).map(tuple),
    st.lists(TREATED, max_size=2).map(tuple),
)
SOME = Results(
    "monday_1",
    "2026-11-22T10:00:00+00:00",
    (
        Measured(
            "m1", "thickness", 6342.5, "um", 6350, 6340, 6360, "us_probe", "us_measure(m1)", 42_000
        ),
        Measured("m4", "profile", 31, "um", 0, -25, 25, "slra", "laser_measure(m4)", 48_000),
        Measured("m5", "profile", 3, "um", None, None, None, "slra", "laser_measure(m5)", 49_000),
        Measured("b1", "torque", 148, "N*cm", 150, 140, 160, "capper", "tighten(b1)", 50_000),
        Measured("b2", "torque", 148, "N*cm", 150, None, None, "", "tighten(b2)", 51_000),
        Measured("b3", "torque", 12, "mm", None, 10, None, "", "tighten(b3)", 51_000),
        Measured(
            "m6",
            "thickness",
            99,
            "um",
            100,
            90,
            110,
            "us_probe",
            "us_measure(m6)",
            52_000,
            8.0,
            5.0,
        ),
        Measured(
            "m7", "thickness", 109, "um", 100, 90, 110, "us_probe", "us_measure(m7)", 53_000, 8.0
        ),
        Measured(
            "m8", "thickness", 120, "um", 100, 90, 110, "us_probe", "us_measure(m8)", 54_000, 8.0
        ),
    ),
)


@given(RESULTS)
def test_json_is_read_back_equal(results: Results) -> None:
    assert read_results_text(write_results(results, ResultForm.JSON), ResultForm.JSON) == results


@given(RESULTS)
@pytest.mark.parametrize("form", [ResultForm.CSV, ResultForm.QIF])
def test_measured_values_are_read_back_equal(form: ResultForm, results: Results) -> None:
    back = read_results_text(write_results(results, form), form)
    assert back.measured == results.measured
    if results.measured or form is ResultForm.QIF:
        assert (back.run, back.started) == (results.run, results.started)


def test_a_verdict_is_written_for_people_and_other_programs() -> None:
    table = write_results(SOME, ResultForm.CSV).splitlines()
    assert table[1].startswith(
        "monday_1,2026-11-22T10:00:00+00:00,42000,m1,thickness,6342.5,um,6350,6340,6360,yes"
    )
    assert [line.split(",")[10] for line in table[1:]] == [
        "yes",
        "no",
        "",
        "yes",
        "",
        "yes",
        "yes",
        "yes",
        "no",
    ]
    assert [line.split(",")[-1] for line in table[-3:]] == [
        "conforming",
        "undecided",
        "not conforming",
    ]
    root = ElementTree.fromstring(write_results(SOME, ResultForm.QIF).encode())
    told = [each.text for each in root.iter(f"{SPACE}CharacteristicStatusEnum")]
    assert told[:6] == ["PASS", "FAIL", "NOT_ANALYZED", "PASS", "NOT_ANALYZED", "PASS"]
    assert told[6:] == ["PASS", "INDETERMINATE", "FAIL"]
    assert [each.text for each in root.iter(f"{SPACE}InspectionStatusEnum")] == ["FAIL"]


@given(RESULTS)
def test_ids_in_qif_are_unique_and_refer_to_what_is_there(results: Results) -> None:
    root = ElementTree.fromstring(write_results(results, ResultForm.QIF).encode())
    ids = [each.attrib["id"] for each in root.iter() if "id" in each.attrib]
    assert len(ids) == len({*ids})
    assert max(map(int, ids)) <= int(root.attrib["idMax"])
    refers = [
        each.text for each in root.iter() if each.tag.endswith("Id") and each.tag != f"{SPACE}QPId"
    ]
    assert {*refers} <= {*ids}
    for each in root.iter():
        if "n" in each.attrib:
            assert int(each.attrib["n"]) == len(each) > 0


@pytest.mark.skipif(not SCHEMA.is_file(), reason="the schemas of QIF are not there")
@pytest.mark.parametrize(
    "results", [SOME, Results("empty"), Results("one", "", SOME.measured[4:5])]
)
def test_qif_is_valid_against_its_schema(results: Results, tmp_path: Path) -> None:
    xmlschema = pytest.importorskip("xmlschema")
    document = tmp_path / "results.qif"
    document.write_text(write_results(results, ResultForm.QIF), "utf-8")
    assert [
        str(each.reason) for each in xmlschema.XMLSchema(str(SCHEMA)).iter_errors(str(document))
    ] == []


@pytest.mark.parametrize(("form", "text"), [
    (ResultForm.JSON, "[]"), (ResultForm.JSON, '{"version": 2}'), (ResultForm.CSV, "a,b\n1,2\n"),
    (ResultForm.QIF, "<a/>"), (ResultForm.QIF, "<a"), (ResultForm.QIF, "<!DOCTYPE a><a/>"),
])  # fmt: skip
def test_another_text_is_refused(form: ResultForm, text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        read_results_text(text, form)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("value", "NaN"),
        ("value", "1e400"),
        ("value", "1" + "0" * 400),
        ("value", '"1"'),
        ("value", "true"),
        ("upper", "-Infinity"),
        ("unit", "7"),
        ("at_ms", "0.5"),
    ],
)
def test_a_json_text_with_a_value_of_another_kind_is_no_results(key: str, value: str) -> None:
    text = (
        f'{{"version": 1, "run": "r", "started": "", "measured": [{{"of": "m", "quantity": "q", '
        f'"{key}": {value}}}], "history": []}}'
    )
    with pytest.raises(ValueError, match=f"`{key}` cannot be|not results"):
        read_results_text(text, ResultForm.JSON)


@pytest.mark.parametrize(
    ("name", "count", "wrong"),
    [("QIF_Results_Sample", 13, {"6", "9", "4"}), ("WIDGET_QIF_RESULTS", 42, {"6", "7", "19"})],
)
def test_results_of_other_programs_are_read_with_their_verdicts(
    name: str, count: int, wrong: set[str]
) -> None:
    file = SCHEMA.parents[2] / "results" / f"{name}.QIF"
    if not file.is_file():
        pytest.skip("the samples of QIF are not there")
    text = file.read_text()
    results = read_results_text(text, ResultForm.QIF)
    assert len(results.measured) == count
    assert {each.of for each in results.measured if each.passed is False} == wrong
    values = [
        each
        for each in ElementTree.fromstring(text).iter()
        if each.tag.endswith("CharacteristicMeasurement")
    ]
    told = [each.findtext(f"{SPACE}Status/{SPACE}CharacteristicStatusEnum") for each in values]
    differs = [
        (each.value, said)
        for each, said in zip(results.measured, told, strict=True)
        if {True: "PASS", False: "FAIL"}.get(each.passed, said) != said
    ]
    assert differs in ([], [(0.0, "FAIL")])  # the sample judges both points of a profile together

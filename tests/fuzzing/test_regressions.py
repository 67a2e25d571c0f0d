"""What campaigns of mutated inputs have found stays mended, and some more cases of each reader
are tried.
"""

import json
from pathlib import Path

import campaign
import numpy as np
import pytest
from fuzz_guards import batch
from fuzz_measured import IMAGE
from fuzz_readers import REFUSALS, Reader
from fuzz_requests import PARSERS
from fuzz_seeds import PCD, npy

FOUND = {
    "range image content": [
        json.dumps({**IMAGE, "range_m": [[5e-324] * 12] * 10}).encode(),
        json.dumps({**IMAGE, "strength": [[5e-324] * 12] * 10}).encode(),
    ],
    "ranges PCD": [
        PCD.replace("0 0 1\n", place).encode()
        for place in ("1e300 0 1\n", "1 0 1e-300\n", "nan 0 1\n")
    ],
    "ranges NPY": [npy(np.full((6, 8), 5e-324)), npy(np.full((6, 8), 1e300))],
    "notation": [b"at(arm, " + b"9" * 5000 + b")"],
    "term": [b'p("\xed\xa0\x80")', b"9" * 5000],
    "PDDL problem": [
        b"(define (problem p) (:domain workshop) (:init (= (way bin shelf) "
        + b"9" * 5000
        + b")) (:goal (and)))",
        "(define (problem p) (:domain workshop) (:init (= (way bin shelf) \u00b2)) (:goal "
        "(and)))".encode(),
    ],
    "simulator log": [
        b"[]\n",
        b'{"at_ms": "x"}\n',
        b'{"at_ms": 1, "sent": [{}]}\n',
        b"\xff\n",
        b"[" * 100_000,
    ],
    "MACROPs": [
        b'{"version": 1, "macrops": [{"macrop": "a", "domain": "b", "plan": [{"id": 1e400}]}]}',
        b'{"version": 1, "macrops": [{"macrop": "'
        + b"(" * 5000
        + b'", "domain": "b", "plan": []}]}',
        b'{"version": 1, "macrops": [{"macrop": "a", "domain": "b", "goals": ["'
        + b"f(" * 5000
        + b'"], "plan": []}]}',
    ],
    "controller": [
        b'{"type": "send", "commands": [{"number": 1, "kind": "step", "stream": "a", "action": "b", "choices": 3}]}'
    ],
    "results json": [b'{"version": 1}', b"[" * 100_000],
    "rules": [b'p("\xed\xa0\x80").', b"x," * 100_000 + b"y."],
    "motion set": [b"[" * 100_000],
    "acts": [
        b"[" * 100_000,
        b'[{"body": []}]',
        b'[{"body": "wheel", "at": [1e400, 1' + b"0" * 400 + b", 0]}]",
    ],
    "number": [b"9" * 200_000 + b"x"],
    "driver options": [b"lookahead=nan", b"lookahead=inf", b"answer=1e400"],
    "monitor request": [b'{"headers": {"host": "127.0.0.1:8210", "origin": "http://[x"}}'],
    "monitor order": [b'{"order": "work", "text": "\\""}', b'{"run": "\\ud800", "order": "skip"}'],
    "journal": [b'{"command": 1, "action": "_"}', b'{"steps": 3}'],
    "results qif": [b'<?xml version="1.0" encoding="UTF-nan"?><a/>'],
    "OBJ": [
        b"f 1 2 3\n",
        b"v 0 0 0\nf 1 2 9\n",
        b"v 1e308 0 0\nv -1e308 0 0\nv 0 1 0\nf 1 2 3\n",
        b"v 0 0 0\nv 1 0 0\nv  0 1\nf 1 2 3\n",
    ],
    "results csv": [
        b"run,started,at_ms,of,quantity,value,unit,nominal,lower,upper,passed,tool,action\na\n"
    ],
}
"""By reader, inputs that once ended in an exception which no reader promises."""

READERS = {each.name: each for each in PARSERS}


def _answers(reader: Reader, data: bytes, folder: Path) -> bool:
    campaign.accompany(reader, folder)
    (folder / reader.file).write_bytes(data)
    try:
        reader.read(folder / reader.file)
    except REFUSALS:
        return False
    return True


@pytest.mark.parametrize("name", FOUND)
def test_what_was_found_is_answered(name: str, tmp_path: Path) -> None:
    for data in FOUND[name]:
        _answers(READERS[name], data, tmp_path)


@pytest.mark.parametrize("name", READERS)
def test_mutated_inputs_are_read_or_refused(name: str, tmp_path: Path) -> None:
    campaign.accompany(READERS[name], tmp_path)
    case = campaign.case_of(READERS[name], 7, tmp_path)
    for number in range(5):
        case(number)


def test_a_case_is_known_by_its_number(tmp_path: Path) -> None:
    reader = READERS["plan"]
    first = campaign.written(reader, 3, 17, tmp_path).read_bytes()
    assert campaign.written(reader, 3, 17, tmp_path).read_bytes() == first
    assert campaign.written(reader, 3, 18, tmp_path).read_bytes() != first


def test_a_batch_goes_on_behind_a_case_that_ends_its_process() -> None:
    import os

    def case(number: int) -> bool:
        if number == 2:
            os._exit(3)
        if number == 3:
            raise ValueError("three")
        return number > 3

    found = batch(range(6), case)
    assert (found.cases, found.refused, found.accepted) == (6, 2, 2)
    assert sorted(found.failures) == [2, 3]
    assert "three" in found.failures[3]


def test_a_campaign_goes_on_where_it_stopped(tmp_path: Path) -> None:
    for cases in (1, 2):
        state = campaign.State(tmp_path, 5)
        campaign.run(state, 5, 0.001, "job shop")
        assert len(campaign.State(tmp_path, 5).tallies) == 1
        assert campaign.State(tmp_path, 5).tallies["job shop"].cases >= cases

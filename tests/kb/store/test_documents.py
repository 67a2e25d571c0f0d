"""What is written of a MACROP is read back as it was, and nothing else is taken for one."""

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from macrops import macrop, macrops, parts, terms

from cellwright.kb.model.conditions import BodyPart
from cellwright.kb.model.plan_model import Macrop
from cellwright.kb.store import NotationError, document, dumps, loads
from cellwright.kb.store.term_notation import read_part, read_term
from cellwright.kb.terms import Term


@given(terms)
def test_terms_are_read_as_they_were_written(term: Term) -> None:
    assert read_term(str(term)) == term


@given(parts)
def test_parts_of_bodies_are_read_as_they_were_written(part: BodyPart) -> None:
    assert read_part(str(part)) == part


@given(macrops)
@settings(max_examples=20, suppress_health_check=[HealthCheck.too_slow])
def test_macrops_are_read_as_they_were_written(found: Macrop) -> None:
    assert loads(dumps(found)) == found


@given(st.text(max_size=30))
def test_other_texts_are_refused_or_are_terms(text: str) -> None:
    try:
        found = read_term(text)
    except NotationError:
        return
    assert read_term(str(found)) == found


@pytest.mark.parametrize("text", ["", "[]", "{}", "{", '{"macrop": 3}', '{"macrop": "p("}'])
def test_what_is_no_macrop_is_refused(text: str) -> None:
    with pytest.raises(NotationError):
        loads(text)


def test_a_missing_plan_is_refused() -> None:
    kept = {key: value for key, value in document(macrop("go")).items() if key != "plan"}
    with pytest.raises(NotationError):
        loads(json.dumps(kept))

"""MACROPs as readable JSON documents. The same MACROP gives the same bytes."""

import json
from collections.abc import Iterable, Mapping
from typing import Any

from cellwright.kb.json_text import parsed
from cellwright.kb.model.conditions import Comparison, Parameter
from cellwright.kb.model.macro import MacroChain, Macrop, MacroPart, MacroStep
from cellwright.kb.model.plan import CausalLink, StepId
from cellwright.kb.store.notation import NotationError, read_atom, read_literal, read_part, read_term
from cellwright.kb.terms import Variable


def document(macrop: Macrop) -> dict[str, Any]:
    """A MACROP in the form of ITA's figure 4, for JSON. Empty parts are left out."""
    found: dict[str, Any] = {
        "macrop": str(macrop.name),
        "domain": macrop.domain,
        "subsequence": macrop.subsequence,
        "goals": _texts(macrop.goals),
        "workflow": [_chain_document(chain) for chain in macrop.chains],
        "preconditions": _texts(macrop.preconditions),
        "adders": _texts(macrop.adders),
        "unary constraints": {str(each.variable): [] for each in macrop.types},
        "n-ary constraints": _texts(macrop.constraints),
        "different": _texts(macrop.disequalities),
        "excluded": [_texts(body) for body in macrop.exclusions],
        "resources": _texts(macrop.resources),
        "plan": [_step_document(step) for step in macrop.steps],
        "parts": [{"macrop": part.name, "steps": list(part.steps)} for part in macrop.parts],
        "links": [[link.producer, str(link.condition), link.consumer] for link in macrop.links],
        "depends": dict(macrop.depends),
    }
    for each in macrop.types:
        found["unary constraints"][str(each.variable)].append(each.type)
    return {key: value for key, value in found.items() if value}


def _texts(parts: Iterable[object]) -> list[str]:
    return [str(part) for part in parts]


def _step_document(step: MacroStep) -> dict[str, Any]:
    found = {
        "id": step.id,
        "operator": str(step.operator),
        "after": list(step.after),
        "resources": _texts(step.resources),
        "duration": str(step.duration),
        "cost": str(step.cost),
    }
    return {key: value for key, value in found.items() if value}


def _chain_document(chain: MacroChain) -> dict[str, Any]:
    found = {
        "name": str(chain.name),
        "subject": str(chain.subject) if chain.subject is not None else None,
        "stages": _texts(chain.stages),
        "after": _texts(chain.after),
    }
    return {key: value for key, value in found.items() if value}


def macrop_of(found: Mapping[str, Any]) -> Macrop:
    """The MACROP that a document describes. Raises `NotationError` if the document is not a MACROP."""
    try:
        return _read(found)
    except RecursionError:
        raise NotationError("not a MACROP: nested too deeply") from None
    except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
        if isinstance(error, NotationError):
            raise
        raise NotationError(f"not a MACROP: {type(error).__name__}: {error}") from None


def _read(found: Mapping[str, Any]) -> Macrop:
    different = [read_part(each) for each in found.get("different", ())]
    if not all(isinstance(each, Comparison) for each in different):
        raise NotationError("a difference is written X != Y")
    unary = found.get("unary constraints", {})
    return Macrop(
        read_atom(found["macrop"]),
        str(found["domain"]),
        tuple(map(read_literal, found.get("goals", ()))),
        tuple(map(read_literal, found.get("preconditions", ()))),
        tuple(map(read_atom, found.get("adders", ()))),
        tuple(Parameter(Variable(name), str(type_)) for name, types in unary.items() for type_ in types),
        tuple(map(read_part, found.get("n-ary constraints", ()))),
        tuple(each for each in different if isinstance(each, Comparison)),
        tuple(tuple(map(read_part, body)) for body in found.get("excluded", ())),
        tuple(map(read_term, found.get("resources", ()))),
        tuple(map(_step, found["plan"])),
        tuple(CausalLink(StepId(int(a)), read_atom(c), StepId(int(b))) for a, c, b in found.get("links", ())),
        tuple(map(_chain, found.get("workflow", ()))),
        {str(part): str(digest) for part, digest in found.get("depends", {}).items()},
        tuple(
            MacroPart(str(each["macrop"]), tuple(StepId(int(n)) for n in each["steps"]))
            for each in found.get("parts", ())
        ),
        bool(found.get("subsequence", False)),
    )


def _step(found: Mapping[str, Any]) -> MacroStep:
    return MacroStep(
        StepId(int(found["id"])),
        read_atom(found["operator"]),
        tuple(StepId(int(each)) for each in found.get("after", ())),
        tuple(map(read_term, found.get("resources", ()))),
        read_term(found["duration"]),
        read_term(found["cost"]),
    )


def _chain(found: Mapping[str, Any]) -> MacroChain:
    subject = found.get("subject")
    return MacroChain(
        read_term(found["name"]),
        tuple(map(read_atom, found.get("stages", ()))),
        tuple(map(read_term, found.get("after", ()))),
        read_term(subject) if subject is not None else None,
    )


def dumps(macrop: Macrop) -> str:
    """A MACROP as one JSON text."""
    return json.dumps(document(macrop), ensure_ascii=False)


def loads(text: str) -> Macrop:
    """The MACROP in a JSON text. Raises `NotationError`."""
    try:
        found = parsed(text)
    except ValueError as error:
        raise NotationError(f"not JSON: {error}") from None
    if not isinstance(found, dict):
        raise NotationError("not a MACROP: no JSON object")
    return macrop_of(found)

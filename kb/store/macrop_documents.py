"""MACROPs as JSON documents, and the records in which a library takes and gives them."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from cellwright.kb.json_text import parse_json
from cellwright.kb.model.conditions import Comparison, Parameter
from cellwright.kb.model.plan_model import (
    CausalLink,
    MacroChain,
    Macrop,
    MacroPart,
    MacroStep,
    StepId,
)
from cellwright.kb.store.term_notation import (
    NotationError,
    Requirement,
    read_literal,
    read_part,
    read_stored_atom,
    read_term,
)
from cellwright.kb.terms import Variable


class Saving:
    """What the uses of a MACROP of a library have brought."""

    __slots__ = ()
    uses: int
    planning_s: float
    lookup_s: float

    @property
    def saved_s(self) -> float:
        """The planning time that it has saved in seconds, minus the time for looking it up."""
        return self.uses * self.planning_s - self.lookup_s


@dataclass(frozen=True, slots=True)
class Record:
    """A MACROP to be stored under the signature of its goals. `planning_s` is the planning time
    when it was learned.

    `requirements` are the conditions of the index on a query; if missing, they are computed at the
    first lookup.
    """

    macrop: Macrop
    signature: str
    planning_s: float = 0.0
    requirements: tuple[Requirement, ...] | None = None


@dataclass(frozen=True, slots=True)
class Stored(Saving):
    """A MACROP of a library with its number and its uses."""

    id: int
    macrop: Macrop
    signature: str
    uses: int = 0
    planning_s: float = 0.0
    lookup_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Use:
    """How often a MACROP was used, and the total time for looking it up in seconds."""

    times: int
    lookup_s: float


@dataclass(frozen=True, slots=True)
class Figures:
    """The figures of a library. `domains` counts MACROPs by domain."""

    macrops: int
    shapes: int
    uses: int
    saved_s: float
    domains: Mapping[str, int]
    schema: int


def document(macrop: Macrop) -> dict[str, Any]:
    """A MACROP in the form of ITA's figure 4, for JSON. Empty parts are left out."""
    document_parts: dict[str, Any] = {
        "macrop": str(macrop.name),
        "domain": macrop.domain,
        "subsequence": macrop.subsequence,
        "goals": _part_texts(macrop.goals),
        "workflow": [_chain_document(chain) for chain in macrop.chains],
        "preconditions": _part_texts(macrop.preconditions),
        "adders": _part_texts(macrop.adders),
        "unary constraints": {str(variable_type.variable): [] for variable_type in macrop.types},
        "n-ary constraints": _part_texts(macrop.constraints),
        "different": _part_texts(macrop.disequalities),
        "excluded": [_part_texts(body) for body in macrop.exclusions],
        "resources": _part_texts(macrop.resources),
        "plan": [_step_document(step) for step in macrop.steps],
        "parts": [{"macrop": part.name, "steps": list(part.steps)} for part in macrop.parts],
        "links": [[link.producer, str(link.condition), link.consumer] for link in macrop.links],
        "depends": dict(macrop.depends),
    }
    for typed_variable in macrop.types:
        document_parts["unary constraints"][str(typed_variable.variable)].append(
            typed_variable.type
        )
    return {key: value for key, value in document_parts.items() if value}


def _part_texts(parts: Iterable[object]) -> list[str]:
    return [str(part) for part in parts]


def _step_document(step: MacroStep) -> dict[str, Any]:
    step_parts = {
        "id": step.id,
        "operator": str(step.operator),
        "after": list(step.after),
        "resources": _part_texts(step.resources),
        "duration": str(step.duration),
        "cost": str(step.cost),
    }
    return {key: value for key, value in step_parts.items() if value}


def _chain_document(chain: MacroChain) -> dict[str, Any]:
    chain_parts = {
        "name": str(chain.name),
        "subject": str(chain.subject) if chain.subject is not None else None,
        "stages": _part_texts(chain.stages),
        "after": _part_texts(chain.after),
    }
    return {key: value for key, value in chain_parts.items() if value}


def macrop_of(document_parts: Mapping[str, Any]) -> Macrop:
    """The MACROP that a document describes.

    Raises `NotationError` if the document is not a MACROP.
    """
    try:
        return _read_macrop(document_parts)
    except RecursionError:
        raise NotationError("not a MACROP: nested too deeply") from None
    except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
        if isinstance(error, NotationError):
            raise
        raise NotationError(f"not a MACROP: {type(error).__name__}: {error}") from None


def _read_macrop(document_parts: Mapping[str, Any]) -> Macrop:
    different = [
        read_part(comparison_text) for comparison_text in document_parts.get("different", ())
    ]
    if not all(isinstance(comparison, Comparison) for comparison in different):
        raise NotationError("a difference is written X != Y")
    unary = document_parts.get("unary constraints", {})
    return Macrop(
        read_stored_atom(document_parts["macrop"]),
        str(document_parts["domain"]),
        tuple(map(read_literal, document_parts.get("goals", ()))),
        tuple(map(read_literal, document_parts.get("preconditions", ()))),
        tuple(map(read_stored_atom, document_parts.get("adders", ()))),
        tuple(
            Parameter(Variable(name), str(type_))
            for name, types in unary.items()
            for type_ in types
        ),
        tuple(map(read_part, document_parts.get("n-ary constraints", ()))),
        tuple(comparison for comparison in different if isinstance(comparison, Comparison)),
        tuple(tuple(map(read_part, body)) for body in document_parts.get("excluded", ())),
        tuple(map(read_term, document_parts.get("resources", ()))),
        tuple(map(_read_step, document_parts["plan"])),
        tuple(
            CausalLink(StepId(int(a)), read_stored_atom(c), StepId(int(b)))
            for a, c, b in document_parts.get("links", ())
        ),
        tuple(map(_read_chain, document_parts.get("workflow", ()))),
        {str(part): str(digest) for part, digest in document_parts.get("depends", {}).items()},
        tuple(
            MacroPart(str(part["macrop"]), tuple(StepId(int(n)) for n in part["steps"]))
            for part in document_parts.get("parts", ())
        ),
        bool(document_parts.get("subsequence", False)),
    )


def _read_step(step_parts: Mapping[str, Any]) -> MacroStep:
    return MacroStep(
        StepId(int(step_parts["id"])),
        read_stored_atom(step_parts["operator"]),
        tuple(StepId(int(step_id)) for step_id in step_parts.get("after", ())),
        tuple(map(read_term, step_parts.get("resources", ()))),
        read_term(step_parts["duration"]),
        read_term(step_parts["cost"]),
    )


def _read_chain(chain_parts: Mapping[str, Any]) -> MacroChain:
    subject = chain_parts.get("subject")
    return MacroChain(
        read_term(chain_parts["name"]),
        tuple(map(read_stored_atom, chain_parts.get("stages", ()))),
        tuple(map(read_term, chain_parts.get("after", ()))),
        read_term(subject) if subject is not None else None,
    )


def dumps(macrop: Macrop) -> str:
    """A MACROP as one JSON text."""
    return json.dumps(document(macrop), ensure_ascii=False)


def loads(text: str) -> Macrop:
    """The MACROP in a JSON text. Raises `NotationError`."""
    try:
        parsed_document = parse_json(text)
    except ValueError as error:
        raise NotationError(f"not JSON: {error}") from None
    if not isinstance(parsed_document, dict):
        raise NotationError("not a MACROP: no JSON object")
    return macrop_of(parsed_document)

"""The `operations` of a `cell.yaml`: what an arm does in the steps of the domain's operators."""

from fractions import Fraction

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.loader.cell.locations import Known
from cellwright.kb.loader.quantities import child
from cellwright.kb.loader.reader import Findings, Reader
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.cell import Ends, Operation
from cellwright.kb.syntax import SECONDS
from cellwright.kb.terms import Function, Term, Variable, is_ground, variables


def read_operations(reader: Reader, findings: Findings, known: Known) -> tuple[Operation, ...]:
    """The entries in their order. Errors are added to `findings`."""
    found = []
    for _, key, node in reader.entries("operations"):
        operator = reader.parse("atom", key)
        if operator is not None:
            found.append(_operation(reader, findings, known, operator.value, key, node))
    return tuple(found)


def _operation(
    reader: Reader, findings: Findings, known: Known, operator: Function, key: Node, node: Node
) -> Operation:
    at = child(node, "at")
    place = _place(reader, findings, known, operator, at)
    beside = child(node, "with")
    other, carried = _place(reader, findings, known, operator, beside), child(node, "carries")
    if (beside is not None and at is None) or (carried is not None and beside is None):
        findings.add(
            node.where, "K005", "two arms need two places", "give `at` and `with`: where each of them goes"
        )
    ends = child(node, "ends")
    drags, drives = (_moving(child(node, each), findings, known) for each in ("drags", "drives"))
    if at is None and drags:
        findings.add(
            node.where, "K005", "nothing is dragged without a place", "give `at`: where it is gripped"
        )
    takes = _seconds(child(node, "takes"))
    stop = Ends(ends.value if ends else "outside")
    load = None if carried is None else _load(reader, findings, known, operator, carried)
    return Operation(operator, place, stop, drags, drives, takes, key.where, other, load)


def _place(
    reader: Reader, findings: Findings, known: Known, operator: Function, node: Node | None
) -> Term | None:
    """A place of the cell, perhaps with variables of the operator; None if none is given."""
    if node is None:
        return None
    parsed = reader.parse("term", node)
    place: Term | None = parsed.value if parsed else None
    _check_place(operator, place, node, findings, known)
    return place


def _load(reader: Reader, findings: Findings, known: Known, operator: Function, node: Node) -> Term | None:
    """The body that two arms carry: one of the cell, or a variable of the operator."""
    parsed = reader.parse("term", node)
    if parsed is None:
        return None
    load: Term = parsed.value
    if is_ground(load) and str(load) not in known.bodies:
        findings.note(unknown_name("body", str(load), known.bodies, node.where))
    _check_place(operator, None if is_ground(load) else load, node, findings, known)
    return load


def _seconds(node: Node | None) -> float:
    """A time in s; 0 if none is given."""
    if node is None:
        return 0.0
    number = str(node.value).rstrip("mins ")
    return float(Fraction(number) * SECONDS[str(node.value)[len(number) :].strip() or "s"])


def _check_place(
    operator: Function, place: Term | None, node: Node, findings: Findings, known: Known
) -> None:
    """Report a place that the cell has not, and a variable that the operator has not."""
    if place is None:
        return
    own = set(variables(operator))
    for variable in variables(place):
        if Variable(variable.name) not in own:
            hint = f"use a variable of the operator {operator}"
            findings.add(node.where, "K105", f"the operator has no variable '{variable.name}'", hint)
    if is_ground(place) and str(place) not in known.places:
        findings.note(unknown_name("place", str(place), known.places, node.where))


def _moving(node: Node | None, findings: Findings, known: Known) -> str:
    """The name of a body with a joint; empty if none is given."""
    if node is None:
        return ""
    moving = {name: body for name, body in known.bodies.items() if body.guide is not None}
    if node.value not in moving:
        findings.note(unknown_name("body with a joint", node.value, moving, node.where))
    return str(node.value)

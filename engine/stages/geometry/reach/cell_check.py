"""Finds what is wrong with a `cell.yaml`: shapes, names, and places that no arm reaches."""

from collections.abc import Callable, Collection, Iterator
from pathlib import Path

from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry.reach.place_reachability import unreached_places
from cellwright.engine.stages.geometry.region_tree import declared_tree
from cellwright.engine.stages.geometry.shapes.meshes import surface_only
from cellwright.engine.stages.geometry.shapes.part_shapes import check_polyhedron, shape_cores
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.diagnostics import (
    Diagnostic,
    InvalidInput,
    nearest_hint,
    select_errors,
    unknown_name,
)
from cellwright.kb.loader.cell import read_cell
from cellwright.kb.loader.reader import LoadFindings
from cellwright.kb.model.body_shapes import Mesh, PlacedShape, Polyhedron
from cellwright.kb.model.cell_model import Cell
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.terms import Atom, Function, Term, natural_key

MAX_NAMES_SHOWN = 3


def check_cell(
    path: Path,
    domain: Domain,
    backend: Callable[[], GeometryBackend] | None = None,
    atoms: Collection[Atom] = (),
    located: Collection[str] = (),
) -> list[Diagnostic]:
    """Everything that is wrong with a cell file, in order of place.

    `atoms` are those that can become true: the places that they name must have a pose, unless facts
    give their position (`located`). Without a backend, reach is not checked. Checks that need a
    correct file run only if the earlier checks found nothing.
    """
    findings = LoadFindings()
    try:
        cell = read_cell(path, findings)
    except InvalidInput as error:
        return list(error.diagnostics)
    diagnostics = [*findings.diagnostics]
    if select_errors(diagnostics):
        return sorted(set(diagnostics))
    diagnostics += [
        *_strange_places(cell, domain),
        *_strange_facts(cell, domain),
        *_strange_operations(cell, domain),
        *_placeless_terms(cell, atoms, located),
        *(wrong for shape in _cell_shapes(cell) for wrong in _shape_problems(shape)),
    ]
    if not select_errors(diagnostics):
        diagnostics += _outside_regions(cell)
    if backend is not None and not select_errors(diagnostics):
        diagnostics += _unreached_places(cell, backend())
    return sorted(set(diagnostics))


def _strange_places(cell: Cell, domain: Domain) -> Iterator[Diagnostic]:
    """Places whose name is neither a possible term of the domain, nor one that an operation of
    the cell goes to.
    """
    known_names = {*domain.functions, *domain.objects}
    known_names |= {
        str(stop).partition("(")[0] for operation in cell.operations for stop in operation.stops
    }
    for name, place in cell.places.items():
        functor = name.partition("(")[0]
        if functor not in known_names:
            hint = (
                nearest_hint(functor, known_names) or "places are called as the domain's terms are"
            )
            message = f"the domain knows no '{functor}'"
            yield Diagnostic(place.placement.where, "K101", message, hint, warning=True)


def _strange_facts(cell: Cell, domain: Domain) -> Iterator[Diagnostic]:
    """Locations whose fact is not a possible atom of the domain."""
    for location in cell.locations:
        fact, signatures = location.fact, domain.predicates
        if fact.name not in signatures:
            yield unknown_name("predicate", fact.name, signatures, location.where)
        elif len(fact.arguments) != (arity := len(signatures[fact.name].arguments)):
            message = f"{fact.name} has {arity} arguments, not {len(fact.arguments)}"
            yield Diagnostic(location.where, "K102", message, "write it as the domain declares it")


def _strange_operations(cell: Cell, domain: Domain) -> Iterator[Diagnostic]:
    """Operations of operators that the domain has not."""
    signatures = {operator.name: len(operator.parameters) for operator in domain.operators}
    for operation in cell.operations:
        name, count = operation.operator.name, len(operation.operator.arguments)
        if name not in signatures:
            yield unknown_name("operator", name, signatures, operation.where)
        elif count != signatures[name]:
            message = f"{name} has {signatures[name]} arguments, not {count}"
            yield Diagnostic(operation.where, "K102", message, "write it as the domain declares it")


def _placeless_terms(
    cell: Cell, atoms: Collection[Atom], located: Collection[str]
) -> Iterator[Diagnostic]:
    """Terms such as slot(drawer, 5) for which the cell has no pose, although it has one for another
    term of the same name: one finding for each such name.
    """
    kin = {name.partition("(")[0]: place for name, place in cell.places.items() if "(" in name}
    terms = {term for atom in atoms for term in _compound_terms(atom) if term.name in kin}
    missing: dict[str, list[str]] = {}
    for term in sorted(terms, key=natural_key):
        if str(term) not in cell.places and str(term) not in located:
            missing.setdefault(term.name, []).append(str(term))
    hint = "say where the tool goes there, or make no problem need it"
    for functor, names in missing.items():
        more = f" and {len(names) - MAX_NAMES_SHOWN} more" if len(names) > MAX_NAMES_SHOWN else ""
        has = "it has no place" if len(names) == 1 else "they have no place"
        message = f"no configuration reaches {', '.join(names[:MAX_NAMES_SHOWN])}{more}: {has}"
        yield Diagnostic(kin[functor].placement.where, "K705", message, hint, warning=True)


def _compound_terms(term: Term) -> Iterator[Function]:
    """All compound terms that a term contains."""
    if isinstance(term, Function):
        for argument in term.arguments:
            if isinstance(argument, Function) and argument.arguments:
                yield argument
            yield from _compound_terms(argument)


def _cell_shapes(cell: Cell) -> Iterator[PlacedShape]:
    for mounted in cell.arms.values():
        for link in mounted.arm.links:
            yield from link.shapes
    for body in cell.bodies.values():
        yield from body.shapes
    yield from (PlacedShape(region.shape) for region in cell.regions.values())


def _shape_problems(placed: PlacedShape) -> list[Diagnostic]:
    try:
        shape_cores(placed.shape)
    except InvalidInput as error:
        return list(error.diagnostics)
    if isinstance(placed.shape, Mesh) and surface_only(Path(placed.shape.path)):
        message, hint = (
            "the mesh is not convex: its surface alone counts",
            "pip install 'cellwright[meshes]'",
        )
        return [Diagnostic(placed.shape.where, "K702", message, hint, warning=True)]
    return check_polyhedron(placed.shape) if isinstance(placed.shape, Polyhedron) else []


def _outside_regions(cell: Cell) -> Iterator[Diagnostic]:
    """Regions that are not within their parents."""
    if any(region.parents for region in cell.regions.values()):
        for error in declared_tree(GeometricWorld.of(cell))[1]:
            where = cell.regions[error.region].where
            yield Diagnostic(
                where,
                "K704",
                str(error),
                "enlarge a parent, name another one, or shrink the region",
            )


def _unreached_places(cell: Cell, backend: GeometryBackend) -> Iterator[Diagnostic]:
    for name, answer in unreached_places(GeometricWorld.of(cell), backend).items():
        where = cell.places[name].placement.where
        message = f"no configuration reaches {name}: {answer.reason}"
        yield Diagnostic(where, "K705", message, answer.hint, warning=True)

"""Makes region trees: the one that a cell declares, and boxes around the pieces of standing bodies."""

from collections.abc import Sequence
from dataclasses import replace

from cellwright.engine.model.geometry import Piece
from cellwright.engine.stages.geometry.regions.tree import OutsideError, RegionTree, TreeRegion
from cellwright.engine.stages.geometry.shapes.packing import bound
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.geometry.world.scenes import pieces_of_region


def nested_boxes(name: str, pieces: Sequence[Piece], parents: tuple[str, ...] = ()) -> list[TreeRegion]:
    """Pieces that stand in the world as solid regions.

    A single piece is a region with the given name. Of several pieces the box around them, along the axes of the first, has
    this name; the pieces are its children `NAME#0`, `NAME#1`, ...
    """
    if len(pieces) == 1:
        return [TreeRegion(name, pieces[0], parents, solid=True)]
    inside = [TreeRegion(f"{name}#{n}", piece, (name,), solid=True) for n, piece in enumerate(pieces)]
    return [TreeRegion(name, bound(pieces), parents), *inside]


def declared_tree(world: World) -> tuple[RegionTree, tuple[OutsideError, ...]]:
    """The tree of the regions that a cell declares, and the regions that reach out of their parents.

    Regions on an arm are left out. A region that reaches out of its parents becomes a root, so that the tree
    is still right. A region made of many pieces counts as the box around it.
    """
    tree, outside = RegionTree.of([]), []
    for name in _parents_first(world):
        region, pieces = world.cell.regions[name], pieces_of_region(world, name)
        if pieces[0].carrier != 0:
            continue
        parents = tuple(parent for parent in region.parents if parent in tree.regions)
        made = nested_boxes(name, pieces, parents)
        top, *rest = (replace(each, solid=each.solid and region.solid) for each in made)
        try:
            tree = tree.attached([top])
        except OutsideError as error:
            outside.append(error)
            tree = tree.attached([replace(top, parents=())])
        tree = tree.attached(rest, nested=True)
    return tree, tuple(outside)


def _parents_first(world: World) -> list[str]:
    regions = world.cell.regions
    import networkx  # takes long to load, and many cells have no regions

    graph: networkx.DiGraph[str] = networkx.DiGraph()
    graph.add_nodes_from(regions)
    graph.add_edges_from((parent, name) for name in regions for parent in regions[name].parents)
    return list(networkx.topological_sort(graph))

"""Makes region trees: the one that a cell declares, and boxes around the pieces of standing bodies."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import networkx
import numpy as np

from engine.model.geometry import Longs, Piece
from engine.stages.geometry.regions.tree import OutsideError, RegionTree, TreeRegion
from engine.stages.geometry.shapes.coverage import Covered, covering
from engine.stages.geometry.shapes.packing import block_between, extent
from engine.stages.geometry.world.model import World
from engine.stages.geometry.world.scenes import pieces_of_region, scene_of

LEAVES = 8  # a box with no more pieces than this is not divided


def nested_boxes(name: str, pieces: Sequence[Piece], parents: tuple[str, ...] = ()) -> list[TreeRegion]:
    """Pieces that stand in the world as solid regions, below boxes along the axes of the first piece.

    A single piece is a region with the given name. With several pieces the outermost box has this name, and
    the regions in it are called `NAME#1.0`, ...
    """
    if len(pieces) == 1:
        return [TreeRegion(name, pieces[0], parents, solid=True)]
    axes = pieces[0].T_carrier_piece[:3, :3]
    extents = np.array([extent(piece, axes) for piece in pieces])
    found: list[TreeRegion] = []
    open_: list[tuple[str, Longs, tuple[str, ...]]] = [(name, np.arange(len(pieces)), parents)]
    while open_:
        box, members, above = open_.pop()
        low, high = extents[members, 0].min(axis=0), extents[members, 1].max(axis=0)
        found.append(TreeRegion(box, block_between(pieces[0], axes, low, high), above))
        stem = box if "#" in box else f"{box}#"
        if len(members) <= LEAVES:
            found += [
                TreeRegion(f"{stem}.{n}", pieces[int(m)], (box,), solid=True) for n, m in enumerate(members)
            ]
            continue
        along = extents[members].sum(axis=1)[:, int(np.argmax(high - low))]
        order = members[np.argsort(along, kind="stable")]
        half = len(order) // 2
        open_ += [(f"{stem}{side}", part, (box,)) for side, part in ((0, order[:half]), (1, order[half:]))]
    return found


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
    graph: networkx.DiGraph[str] = networkx.DiGraph()
    graph.add_nodes_from(regions)
    graph.add_edges_from((parent, name) for name in regions for parent in regions[name].parents)
    return list(networkx.topological_sort(graph))


def region_tree(world: World) -> RegionTree:
    """The tree of all that stands in a world: the declared regions, and each standing body or link in the
    smallest region that holds it.
    """
    tree, _ = declared_tree(world)
    bounds = sorted((each for each in tree.regions.values() if not each.solid), key=_size)
    by_body: dict[str, list[Piece]] = {}
    for piece in scene_of(world).pieces:
        if piece.carrier == 0 and piece.body not in world.cell.regions:
            by_body.setdefault(piece.body, []).append(piece)
    for body, pieces in by_body.items():
        top, *rest = nested_boxes(body, pieces)
        holding = (each.name for each in bounds if isinstance(covering(top.piece, [each.piece]), Covered))
        parents = tuple(islice(holding, 1))
        tree = tree.attached([replace(top, parents=parents)]).attached(rest, nested=True)
    return tree


def _size(region: TreeRegion) -> float:
    """The radius of a ball around the region."""
    return float(np.linalg.norm(np.ptp(region.piece.vertices, axis=0))) / 2 + region.piece.radius_m

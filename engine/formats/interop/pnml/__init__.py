"""PNML (ISO/IEC 15909-2): nets written and read, place/transition nets and symmetric nets.

In a symmetric net, a place of the net by contact class holds the tokens of its clusters, and each transition is written once
for every number of tokens that it moves. That a place must be emptied when its cluster is taken away cannot be said there.
"""

from cellwright.engine.formats.interop.pnml.reading import read_pnml
from cellwright.engine.formats.interop.pnml.writing import write_pnml
from cellwright.engine.model.task_space import Net

__all__ = ["read_pnml", "write_pnml", "written"]


def written(net: Net, coloured: bool) -> str:
    """A net of contact states as PNML: as a symmetric net, or as a place/transition net with a place for each cluster."""
    from cellwright.engine.formats.interop.pnml.nets import symmetric, unfolded

    return write_pnml(symmetric(net) if coloured else unfolded(net))

"""Shops in files of other systems, in any supported format."""

from pathlib import Path

from cellwright.engine.formats.interop.jobshop import read_jobshop
from cellwright.engine.formats.interop.slab import is_slab, read_slab
from cellwright.engine.model.shop import Shop
from cellwright.kb.loader.plan import is_plan

JOB_SHOPS = (".json", ".txt", ".jss", ".jsp")


def shop_of(path: Path, instance: str = "") -> Shop | None:
    """The shop in a folder of S-LAB tables or a job-shop file; None if it is neither. Raises `InvalidInput`."""
    if is_slab(path):
        return read_slab(path)
    if path.is_file() and path.suffix in JOB_SHOPS and not is_plan(path):
        return read_jobshop(path, instance)
    return None

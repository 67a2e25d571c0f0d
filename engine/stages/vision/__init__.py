"""Depth images: made from scenes or read from files, and parts found in them.

The stage knows parts as `cellwright.engine.model.geometry.Solid`; what is not such a part is only
seen.
"""

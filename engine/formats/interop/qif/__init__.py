"""QIF 3.0 (ISO 23952): points to measure, from features, characteristics and their tolerances."""

from engine.formats.interop.qif.features import read_features
from engine.formats.interop.qif.points import inspection_of

__all__ = ["inspection_of", "read_features"]

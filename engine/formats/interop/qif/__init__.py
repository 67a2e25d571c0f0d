"""QIF 3.0 (ISO 23952): points to measure, from features, characteristics and their tolerances,
and as a document of their own.
"""

"""Pictures of a cell, made without a display: shapes become triangles, drawn as PNG or SVG, or
written as glTF with motion.
"""

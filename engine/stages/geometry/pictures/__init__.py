"""Pictures of a cell without a display: shapes as triangles, drawn as PNG or SVG, or written as glTF with motion."""

"""The bundled cells: data files only, found by name."""

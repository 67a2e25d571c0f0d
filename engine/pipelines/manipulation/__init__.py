"""Manipulation: PLACE part ON part and assemblies, planned (Handey) and carried out in physics."""

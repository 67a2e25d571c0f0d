"""How answers are written, and how files of other systems are read and written."""

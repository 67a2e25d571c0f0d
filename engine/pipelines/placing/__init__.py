"""PLACE part ON part: from what is said of the goal to what is seen, taken, taken anew and moved (Handey)."""

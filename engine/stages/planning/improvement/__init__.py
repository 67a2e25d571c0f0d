"""From a first plan to a better one, without any order that it does not need."""

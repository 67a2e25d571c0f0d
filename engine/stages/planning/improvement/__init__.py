"""From a first plan to a better one, freed of every order that it does not need."""

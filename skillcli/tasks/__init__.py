"""Tasks, one room each, and the registry of them."""

"""The basis of recipes, domains and robot files: frozen sections, TOML, distributions, and explained errors."""

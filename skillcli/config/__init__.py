"""What every recipe section is made of: frozen sections, TOML, ranges, and one explainer of errors."""

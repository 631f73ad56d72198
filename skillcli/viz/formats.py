"""Formats of figures."""

FORMATS = ("png", "pdf", "svg")

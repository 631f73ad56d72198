"""Figures of the report: one module per theme, one function per figure; scenes or arrays in, a matplotlib figure out.

All are made inside `figure_style.styled()`, are as wide as a page's text, and distinguish series by dashes and markers as
well as colours.
"""

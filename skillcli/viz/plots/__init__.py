"""Figures for paper: one module per theme, one function per figure; scenes or arrays in, a matplotlib figure out.

All are made inside `canvas.styled()`, are as wide as a page's text, and tell series apart by dash and marker as well as colour.
"""

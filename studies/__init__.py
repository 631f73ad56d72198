"""Studies behind docs/experiments.md: each is a script of its own, `python -m studies.NAME`."""

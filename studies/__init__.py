"""Studies behind docs/experiments/: each is a script of its own, `python -m studies.NAME`."""

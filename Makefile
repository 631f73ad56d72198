# Everything runs from a local virtual environment; versions come from constraints.txt.
PYTHON ?= python3
BIN := .venv/bin
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist loadfile

.PHONY: install demo test quick fuzz check bench docs clean

install: .venv/installed

.venv/installed: pyproject.toml setup.py constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt torch
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	touch $@

demo: install  # the main job: train eight reach skills on the Sawyer, compose, transfer, draw
	$(BIN)/skill demo

test: install
	$(PYTEST)

quick: install  # what neither trains nor takes more than a moment: less than a minute
	$(PYTEST) -m "not slow"

fuzz: install  # random damage to stored files and to HDF5's structures in them, a minute each; `make test` tries a little of it
	SKILL_FUZZ=400 $(PYTEST) tests/store/test_fuzz.py tests/store/test_structure_fuzz.py

check: install  # lint, format, types; the import rules are tests/test_imports.py
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m pytest tests/test_imports.py

bench: install  # our steps against the bare engine, in one run
	$(BIN)/python -m tests.bench

docs: .venv/docs  # the pages of docs/ as a site in build/site; a broken link is an error
	$(BIN)/mkdocs build --quiet --strict
	@echo "build/site/index.html"

.venv/docs: .venv/installed
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[docs]'
	touch $@

clean:
	rm -rf .venv build *.egg-info .pytest_cache .ruff_cache .mypy_cache

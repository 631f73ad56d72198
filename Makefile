# Everything runs from a local virtual environment; versions come from constraints.txt.
PYTHON ?= python3
BIN := .venv/bin
# One process more than there are cores: some tests wait.
PROCESSES := $(shell $(PYTHON) -c "import os; print((os.cpu_count() or 1) + 1)")
PYTEST := $(BIN)/python -m pytest --numprocesses $(PROCESSES) --dist loadfile

.PHONY: install demo test quick fuzz check bench docs reference clean

install: .venv/installed

.venv/installed: pyproject.toml setup.py constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt torch
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	touch $@

demo: install  # the main job: train eight reach skills on the Sawyer, compose, transfer, draw
	$(BIN)/skill demo

test: install  # what waits for a clock afterwards and alone: beside other tests it would judge the machine
	$(PYTEST) -m "not real_time"
	$(BIN)/python -m pytest -m real_time

quick: install  # what neither trains nor takes more than a moment: less than a minute
	$(PYTEST) --numprocesses auto -m "not slow"

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

# The artifacts in artifacts/, made anew in build/reference by the shipped recipes: two hours on two cores.
REFERENCE := $(BIN)/skill --store build/reference
reference: install
	$(REFERENCE) run point --name reference-point
	$(REFERENCE) run reach --name reference-reach
	$(REFERENCE) compose reference-reach/embed-means --method interpolate --task u-shape
	$(REFERENCE) transfer-eval reference-reach/compose-v1 --episodes 30 --domain real-like --replan
	$(REFERENCE) compose reference-reach/embed-means --method ddpg --goal=0.5,0,0.15
	$(REFERENCE) compose reference-reach/embed-means --method ddpg --goal=0.5,0,0.3
	$(REFERENCE) compose reference-reach/embed-means --method ddpg --goal=0.7,0,0.3
	$(REFERENCE) compose reference-reach/embed-means --method ddpg --goal=0.5,0,0.15 --latents interpolated
	$(REFERENCE) pretrain push --name reference-push
	$(REFERENCE) embed-means reference-push/pretrain
	$(REFERENCE) compose reference-push/embed-means --task ring
	$(REFERENCE) transfer-eval reference-push/compose-v1 --episodes 48
	$(REFERENCE) compose reference-push/embed-means --goal=-0.2,0.1
	$(REFERENCE) compose reference-push/embed-means --goal=-0.2,-0.1
	$(REFERENCE) compose reference-push/embed-means --goal=0.2,0.1
	$(REFERENCE) compose reference-push/embed-means --goal=0.2,-0.1
	$(REFERENCE) pretrain push-robust --name reference-push-robust
	$(REFERENCE) embed-means reference-push-robust/pretrain
	$(REFERENCE) compose reference-push-robust/embed-means --goal=0.1,0.1
	$(REFERENCE) transfer-eval reference-push-robust/compose-v1 --episodes 30
	$(REFERENCE) transfer-eval reference-push-robust/compose-v1 --episodes 30 --domain real-like --replan
	$(REFERENCE) pretrain reach-ur5e --name reference-reach-ur5e
	$(REFERENCE) embed-means reference-reach-ur5e/pretrain
	$(REFERENCE) compose reference-reach-ur5e/embed-means --set search.weight=10
	$(REFERENCE) transfer-eval reference-reach-ur5e/compose-v1
	$(REFERENCE) transfer-eval reference-reach-ur5e/compose-v1 --domain real-like --replan --episodes 30
	$(REFERENCE) report -o build/reference.html

clean:
	rm -rf .venv build *.egg-info .pytest_cache .ruff_cache .mypy_cache

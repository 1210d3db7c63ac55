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

.PHONY: help setup setup-dev run test lint format floors lock bench clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' Makefile

setup: $(VENV)/.setup ## prepare .venv with the falconer command in it

run: setup ## fly the demo with the console on http://127.0.0.1:8000 (SCENARIO=name PORT=n)
	@exec $(BIN)/falconer run $(SCENARIO) --port $(PORT)

test: setup-dev ## run the tests (PYTEST_ARGS="..." narrows them)
	@scripts/browser $(BIN)
	$(BIN)/python -m pytest $(PYTEST_ARGS)

lint: setup-dev floors ## check style, formatting, types and floors
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

floors: setup-dev ## check that imports only go down the floors
	$(BIN)/lint-imports --no-logo --no-cache

format: setup-dev ## rewrite the code in the house style
	$(BIN)/ruff check --fix-only .
	$(BIN)/ruff format .

bench: setup-dev ## measure what the design promises
	$(BIN)/python -m pytest benchmarks -o python_files='bench_*.py' --timeout 1800 $(PYTEST_ARGS)

lock: setup-dev ## refresh both lock files from pyproject.toml (UPGRADE=--upgrade for newer ones)
	$(LOCK) $(UPGRADE) --output-file requirements.lock
	$(LOCK) $(UPGRADE) --extra dev --constraints requirements.lock --output-file requirements-dev.lock

clean: ## remove .venv and everything generated
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .benchmarks
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

setup-dev: $(VENV)/.setup-dev

# The stamps stand for what they were made from: a changed lock or pyproject.toml renews them.
$(VENV)/.setup: requirements.lock pyproject.toml | $(VENV)/bin/python
	@echo "Installing Falconer into $(VENV) (about a minute the first time) ..."
	@$(INSTALL) --requirement requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	    --no-deps --no-build-isolation --no-index --editable .
	@echo "Compiling the optimizer's kernels ..."
	@$(BIN)/python -c 'from solver.engines.fast.compiled import compiled; compiled()'
	@touch $@

$(VENV)/.setup-dev: requirements-dev.lock $(VENV)/.setup
	@echo "Installing the development tools into $(VENV) ..."
	@$(INSTALL) --requirement requirements-dev.lock
	@touch $@

$(VENV)/bin/python:
	@python=$$(scripts/python) && echo "Using $$python" && "$$python" -m venv $(VENV)

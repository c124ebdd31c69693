# The two commands of the README: `make demo` and `make test`.
# Both make their own virtual environment in .venv and may be repeated at will.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMPS := .make
# The tests of a file stay together, and all that need a server run on one worker: tests/conftest.py.
PYTEST = $(BIN)/python -m pytest --benchmark-skip --numprocesses 2 --dist loadgroup
# A method a word, with commas for the blanks before its parameters.
DEMO_METHODS := constant local graph-cuts u-net,--param,weights=demo dfd-net,--param,weights=demo

.PHONY: help demo test test-slow test-all browser benchmark leaderboard clean
.DEFAULT_GOAL := help

help: ## Say what there is to make
	@grep -E '^[a-z-]+:.*##' Makefile | sed 's/:.*## /\t/'

demo: $(STAMPS)/installed ## Build the demo set, run the baselines, print tables, draw figures
	@echo "== building the demo set"
	@$(BIN)/dfdbench build demo
	@for method in $(DEMO_METHODS); do \
	  echo; echo "== dfdbench run --dataset demo --method $$(echo $$method | tr ',' ' ')"; \
	  $(BIN)/dfdbench run --dataset demo --method $$(echo $$method | tr ',' ' ') || exit 1; \
	done
	@echo; echo "All of it lies here:"
	@find results/demo-1-test -name '*.png' -o -name result.json | sort | sed 's/^/  /'

test: $(STAMPS)/tested-with ## ruff, mypy --strict, the leaderboard's check, pytest but for the slow tests
	@echo "== ruff: style and imports"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@echo "== mypy --strict: types"
	@$(BIN)/mypy
	@echo "== dfdbench leaderboard --check: results, hashes, README"
	@$(BIN)/dfdbench leaderboard --check
	@echo "== pytest: tests, doctests, the README's examples"
	@$(PYTEST) -m "not slow"

test-slow: $(STAMPS)/tested-with ## The tests that take minutes: many kills, the wheel, whole photographs
	@echo "== pytest: the slow tests"
	@$(PYTEST) -m slow

test-all: test test-slow ## Every test

browser: ## Install Chromium, which the report page's tests need (Debian, as root)
	@command -v chromedriver > /dev/null || { apt-get -qq update && \
	  apt-get -qq install -y --no-install-recommends chromium chromium-driver; }

leaderboard: $(STAMPS)/installed ## Run the leaderboard's rows on the sets that are built here, write its README
	@$(BIN)/python leaderboard/rerun.py

benchmark: $(STAMPS)/tested-with ## Time our code against named peers, as ratios
	@$(BIN)/python -m pytest tests/benchmarks --benchmark-only -s

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "dfdbench needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version 2>&1)."; \
	  echo "Name another with: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@echo "== making a virtual environment in $(VENV) with $$($(PYTHON) --version)"
	@$(PYTHON) -m venv $(VENV)

$(STAMPS)/installed: $(BIN)/python pyproject.toml constraints.txt
	@echo "== installing dfdbench and what it needs (versions: constraints.txt)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[nets]'
	@mkdir -p $(STAMPS) && touch $@

$(STAMPS)/tested-with: $(STAMPS)/installed
	@echo "== installing what the tests need"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@

clean: ## Remove the virtual environment and the results
	rm -rf $(VENV) $(STAMPS) results build dist *.egg-info

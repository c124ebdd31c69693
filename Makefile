# The two commands of the README: `make demo` and `make test`.
# Both make their own virtual environment in .venv and may be repeated at will.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMPS := .make
# Python begins here hundreds of times: what it compiles is kept, whatever the shell says of it.
export PYTHONDONTWRITEBYTECODE :=
# The tests of a file stay together, and all that need a server run on one worker: tests/conftest.py.
# A worker a core: more threads in linear algebra and networks would only wait for each other.
PYTEST = OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest --benchmark-skip \
  --numprocesses 2 --dist loadgroup
# A method a word, with commas for the blanks before its parameters.
DEMO_METHODS := constant s-transform local graph-cuts
COMPILE := "import numpy, dfdbench.methods as m; a = numpy.zeros((9, 9, 3), 'u1'); m.load('graph-cuts', recipe='published')(a, a)"
DEMO_NETS := u-net,--param,weights=demo dfd-net,--param,weights=demo
# One of the three test scenes: a first look should not take minutes.
DEMO_SPLIT := Market
DEMO := results/demo-1-$(DEMO_SPLIT)

.PHONY: help demo demo-nets test test-slow test-all fuzz kills mutants docs browser benchmark size leaderboard release clean
.DEFAULT_GOAL := help

help: ## Say what there is to make
	@grep -E '^[a-z-]+:.*##' Makefile | sed 's/:.*## /\t/'

demo: $(STAMPS)/base ## Build the demo set, run four methods on one of its scenes: a table, a figure, a web page
	@$(BIN)/dfdbench build demo
	@$(call run_each,$(DEMO_METHODS))
	@$(call tell)
	@echo "Next:"
	@echo "  source $(BIN)/activate                          # gives this shell the command dfdbench"
	@echo "  dfdbench check-method mymodule:predict             # your own function: README, ten lines"
	@echo "  dfdbench run --method mymodule:predict --dataset demo --split $(DEMO_SPLIT)"
	@echo "  dfdbench report $(DEMO)/* --out report   # yours beside the four, on a page"
	@echo "  make demo-nets                                     # and two networks; installs PyTorch"

demo-nets: $(STAMPS)/installed ## The networks' rows beside those of `make demo`; needs PyTorch
	@$(BIN)/dfdbench build demo
	@$(call run_each,$(DEMO_METHODS) $(DEMO_NETS))
	@$(call tell)

# A line a method; what it said is shown where it fails. The figures are the report's. Meanwhile the
# other core compiles, once, what graph cuts need.
define run_each
mkdir -p results; \
$(BIN)/python -c $(COMPILE) > /dev/null 2>&1 & \
for method in $(1); do \
  words=$$(echo $$method | tr ',' ' '); printf '  %-28s' "$$words"; begun=$$(date +%s); \
  $(BIN)/dfdbench run --dataset demo --split $(DEMO_SPLIT) --no-figures --method $$words > results/log.txt 2>&1 || \
    { echo failed; cat results/log.txt; exit 1; }; \
  echo "$$(( $$(date +%s) - begun )) s"; \
done; rm results/log.txt
endef

define tell
$(BIN)/dfdbench report --format table --figure results/demo.png $(DEMO)/*/result.json && \
  printf 'page         ' && $(BIN)/dfdbench report --out results/demo-report $(DEMO)/*/result.json
endef

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

docs: $(STAMPS)/docs-with ## Build the documentation site into build/site; installs MkDocs and PyTorch; a warning is an error
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict
	@echo "build/site/index.html"

browser: ## Install Chromium, which the report page's tests need (Debian, as root)
	@command -v chromedriver > /dev/null || { apt-get -qq update && \
	  apt-get -qq install -y --no-install-recommends chromium chromium-driver; }

fuzz: $(STAMPS)/tested-with ## Spoiled files and strange command lines, SECONDS=90 or INPUTS a class
	@$(BIN)/python -m tests.fuzz --seconds $(or $(SECONDS),90) \
	  $(if $(INPUTS),--inputs $(INPUTS)) $(if $(SEED),--seed $(SEED))

kills: $(STAMPS)/tested-with ## Kill each verb COUNT=100 times and ask for the same again
	@DFDBENCH_KILLS=$(or $(COUNT),100) $(BIN)/python -m pytest -m slow tests/kills

mutants: $(STAMPS)/tested-with ## Change ROOM=metrics in COUNT=25 places, one at a time: which do its tests miss?
	@$(BIN)/python -m tests.mutants $(or $(ROOM),metrics) --count $(or $(COUNT),25) \
	  --seed $(or $(SEED),31)

size: ## Count lines of code by room, without docstrings, comments and blank lines
	@$(PYTHON) -m tests.size

leaderboard: $(STAMPS)/installed ## Run every method on rooms of a SEED, or of a drawn one; write the leaderboard's README
	@$(BIN)/python leaderboard/rerun.py $(if $(SEED),--seed $(SEED))

# One thread, since what is compared is the processor's time. Each benchmark, also those without a
# peer: pytest tests/benchmarks --benchmark-only -s
benchmark: $(STAMPS)/tested-with ## Time our code against named peers: the table of docs/speed.md
	@NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 \
	  $(BIN)/python -m pytest tests/benchmarks --benchmark-only -s --ledger docs/speed.md

# The Pythons that a release is tried on; those that are not here are named and left out.
PYTHONS ?= python3.11 python3.12 python3.13
RELEASE := build/release

release: ## Build wheel and source archive, check them, try them on each of PYTHONS; publishes nothing
	@rm -rf $(RELEASE) && $(PYTHON) -m venv $(RELEASE)/tools
	@$(RELEASE)/tools/bin/pip install --quiet --disable-pip-version-check build twine
	@$(RELEASE)/tools/bin/python -m build --outdir $(RELEASE)/dist . > $(RELEASE)/built.txt
	@$(RELEASE)/tools/bin/twine check --strict $(RELEASE)/dist/*
	@for python in $(PYTHONS); do \
	  $$python -c '' 2> /dev/null || { echo "$$python: not here, left out"; continue; }; \
	  for file in $(abspath $(RELEASE))/dist/*; do \
	    place=$(abspath $(RELEASE))/$$(basename $$python)-$${file##*.}; \
	    $$python -m venv $$place && \
	    $$place/bin/pip install --quiet --disable-pip-version-check "$$file" && cd $$place && \
	    DFDBENCH_CACHE=$$place/cache bin/dfdbench build demo > /dev/null && \
	    DFDBENCH_CACHE=$$place/cache bin/dfdbench run --dataset demo --method constant 2>&1 > /dev/null | grep ^score && \
	    bin/dfdbench leaderboard --format csv 2>&1 > /dev/null && echo "$$python: $${file##*/} works" || exit 1; \
	  done; \
	done

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "dfdbench needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version 2>&1)."; \
	  echo "Name another with: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@echo "== making a virtual environment in $(VENV) with $$($(PYTHON) --version)"
	@$(PYTHON) -m venv $(VENV)

$(STAMPS)/base: $(BIN)/python pyproject.toml constraints.txt
	@echo "== installing dfdbench and what it needs (versions: constraints.txt)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@mkdir -p $(STAMPS) && touch $@

$(STAMPS)/installed: $(STAMPS)/base
	@echo "== installing what the networks need"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[nets]'
	@mkdir -p $(STAMPS) && touch $@

$(STAMPS)/tested-with: $(STAMPS)/installed
	@echo "== installing what the tests need"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@

$(STAMPS)/docs-with: $(STAMPS)/installed
	@echo "== installing what the site needs"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	@touch $@

clean: ## Remove the virtual environment and the results
	rm -rf $(VENV) $(STAMPS) results build dist *.egg-info

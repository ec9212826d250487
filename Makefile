# Every target first makes .venv, or brings it up to date, from constraints.txt.
# Another interpreter: make test PYTHON=python3.12

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
# Those that make the library's data, or need a folder, are run by hand.
BENCHMARKS := $(filter-out $(addprefix benchmarks/,$(addsuffix .py,tuning calibration bounds training_stages \
  trained_policies)),$(shell grep -l __main__ benchmarks/*.py))
PYTEST := $(BIN)/python -m pytest -n auto --maxprocesses 4

# A stamp is the last thing that an installation writes: a half-made one has none, and is started anew.
INSTALLED := $(VENV)/.installed
DOCS_INSTALLED := $(VENV)/.installed-docs

.PHONY: help install reproduce test test-slow coverage check bench docs

help:
	@echo "make install    make .venv, with the program in .venv/bin"
	@echo "make reproduce  run the whole paper and write runs/reproduce/report.html"
	@echo "make test       run the tests"
	@echo "make test-slow  run the tests that take minutes"
	@echo "make coverage   run the tests, and fail where they leave out more than 5 % of the lines"
	@echo "make check      lint, formatting, order of the packages and types"
	@echo "make bench      run the benchmarks and write benchmarks/results/"
	@echo "make docs       build the documentation into site/"

install: $(INSTALLED)

reproduce: $(INSTALLED)
	$(BIN)/archerfish reproduce

test: $(INSTALLED)
	$(PYTEST) --dist worksteal

test-slow: $(INSTALLED)
	$(PYTEST) --dist worksteal -m slow

coverage: $(INSTALLED)
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest -n auto --maxprocesses 4 --dist worksteal
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report

check: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache --no-logo
	$(BIN)/mypy

bench: $(INSTALLED)
	@failed=""; for script in $(BENCHMARKS); do \
	  echo "== $$script"; $(BIN)/python $$script || failed="$$failed $$script"; \
	done; test -z "$$failed" || { echo "failed:$$failed" >&2; exit 1; }

docs: $(DOCS_INSTALLED)
	$(BIN)/zensical build --clean --strict

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "$(PYTHON) must be Python 3.11 or newer; install one, or name it: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "$(PYTHON) has no venv module; install it (Debian, Ubuntu: apt install python3-venv)" >&2; exit 1; }
	@if test -e $@; then rm $@; else echo "making $(VENV) (a few minutes)"; $(PYTHON) -m venv --clear $(VENV); fi
	$(INSTALL) -e '.[train,dev]'
	@touch $@

$(DOCS_INSTALLED): $(INSTALLED)
	$(INSTALL) -e '.[docs]'
	@touch $@

# make run    sets up and runs the main job on the bundled Jinan network
# make test   sets up with everything and passes the checks and tests
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: run test check bench clean

run: $(VENV)/.core
	$(BIN)/tsc-run --net jinan --missing kriging --rate 0.25

test: check
	$(BIN)/python -m pytest --numprocesses 2 --dist worksteal

check: $(VENV)/.all
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/.bench
	$(BIN)/python -m tools.bench

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "tsc_missing needs Python 3.11 or newer; set PYTHON=... to one" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.core: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) --editable .
	@touch $@

$(VENV)/.all: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) --editable '.[dev,sumo,cluster,gym]'
	@touch $@ $(VENV)/.core

$(VENV)/.bench: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) --editable '.[dev,sumo,cluster,gym,bench]'
	@touch $@ $(VENV)/.all $(VENV)/.core

clean:
	rm -rf $(VENV) build dist

# make fit         recover the materials of the built-in example
# make test        lint, types, layers and tests
# make test-slow   the tests that take longer
# make bench       timings against Mitsuba's own plugins and the tutorial's way
# make format      format the code
#
# Each makes .venv first. PYTHON=/path/to/python3 says which Python it is made with.

.PHONY: help fit test test-slow bench format clean
.NOTPARALLEL:
.DELETE_ON_ERROR:

BIN := .venv/bin
PYTEST := $(BIN)/python -m pytest

# No download by pyright, and no question after a newer one.
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1
# What builds the package is pinned as well (pip reads one or the other, by its age).
export PIP_CONSTRAINT := constraints.txt
export PIP_BUILD_CONSTRAINT := constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1

help:
	@sed -n 's/^# \(make .*\)/\1/p' Makefile

fit: .venv/ready
	$(BIN)/brdf example --out out/example

test: .venv/ready-dev
	$(BIN)/python -m ruff check .
	$(BIN)/python -m ruff format --check .
	$(BIN)/lint-imports --no-logo
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(PYTEST) -m "not slow"

test-slow: .venv/ready-dev
	$(PYTEST) -m slow

bench: .venv/ready-dev
	$(PYTEST) tests/bench --benchmark-only

format: .venv/ready-dev
	$(BIN)/python -m ruff check --fix .
	$(BIN)/python -m ruff format .

clean:
	rm -rf .venv out build dist

# The stamps hold the folder they were made in: a copied or moved .venv, or one whose Python is gone, is made anew.
$(shell test "$$(cat .venv/ready 2>/dev/null)" = "$(CURDIR)" && $(BIN)/python -c "" 2>/dev/null || rm -f .venv/ready .venv/ready-dev)

# The first Python on PATH that is new enough and can make an environment with pip in it.
.venv/ready: pyproject.toml constraints.txt
	@rm -rf .venv; \
	try() { \
	    "$$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	        { why="$$why; $$1 is $$("$$1" -V 2>&1 | head -n 1)"; return 1; }; \
	    "$$1" -c 'import ensurepip, venv' 2>/dev/null && "$$1" -m venv .venv >/dev/null 2>&1 || \
	        { why="$$why; $$1 cannot make one (no venv or ensurepip)"; rm -rf .venv; return 1; }; \
	}; \
	search() { \
	    for name in python3 python3.14 python3.13 python3.12 python3.11; do \
	        IFS=:; set -f; for folder in $$PATH; do \
	            unset IFS; [ -x "$$folder/$$name" ] && try "$$folder/$$name" && return 0; \
	        done; unset IFS; \
	    done; return 1; \
	}; \
	if [ -n "$(PYTHON)" ]; then try "$(PYTHON)"; else search; fi || { \
	    echo "make: no Python that is 3.11 or newer and can make an environment$${why:-; there is no python3 on PATH}." \
	        "Install one (Debian, Ubuntu: apt install python3-venv), or name one: make PYTHON=/path/to/python3" >&2; exit 1; }
	@echo "Installing into .venv what constraints.txt pins; the first time this takes a minute or two."
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable .
	@echo "$(CURDIR)" > $@

# The other stamp goes first: an interruption leaves neither, and the next run starts over.
.venv/ready-dev: .venv/ready
	@rm -f .venv/ready
	@echo "Installing into .venv what the tests need."
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@echo "$(CURDIR)" > .venv/ready
	@echo "$(CURDIR)" > $@

# Everything runs in .venv inside this checkout, which is made anew when requirements.lock or pyproject.toml changes.

PYTHON ?= python3
VENV := .venv
READY := $(VENV)/.ready
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check --no-input

.PHONY: help race test coverage lint lock clean

help:
	@echo "make race      fly the five gates in simulation; the run goes to runs/"
	@echo "make test      lint, types and all tests"
	@echo "make coverage  lines that the tests run, those on the wall clock left out"
	@echo "make lint      ruff and mypy only"
	@echo "make lock      pin the dependencies of pyproject.toml in requirements.lock (needs uv)"
	@echo "make clean     remove .venv and caches; runs/ is kept"

race: $(READY)
	@$(VENV)/bin/flightapp fly missions/five_gates.py --sim

# What is judged by the wall clock has the computer to itself.
test: lint
	@$(VENV)/bin/python -m pytest --numprocesses 2 --dist loadfile -m "not wall_clock"
	@$(VENV)/bin/python -m pytest -m wall_clock

coverage: $(READY)
	@$(VENV)/bin/python -m pytest --numprocesses 2 --dist loadfile -m "not wall_clock" \
		--cov flightapp --cov sim --cov-report term:skip-covered

lint: $(READY)
	@$(VENV)/bin/ruff check --quiet .
	@$(VENV)/bin/ruff format --check --quiet . || { echo "not formatted; mend with: $(VENV)/bin/ruff format ." >&2; exit 1; }
	@$(VENV)/bin/mypy --no-error-summary

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
		{ echo "Python 3.11 or newer is needed as $(PYTHON) (Debian, Ubuntu: apt install python3)" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
		{ echo "$(PYTHON) cannot make environments: apt install python3-venv" >&2; exit 1; }
	@$(PYTHON) -m venv --clear $(VENV)
	@$(PIP) install -qq --require-hashes --no-deps --only-binary :all: -r requirements.lock
	@$(PIP) install -qq --no-build-isolation --no-deps -e .
	@$(PIP) check -q
	@touch $@

# Pins that still fit are kept; `make lock UPGRADE=--upgrade` takes the newest releases.
lock:
	@command -v uv >/dev/null || { echo "make lock needs uv: pip install uv" >&2; exit 1; }
	@uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 --generate-hashes \
		--no-emit-index-url --no-emit-find-links --no-annotate --no-config --quiet $(UPGRADE) \
		--custom-compile-command "make lock" --output-file requirements.lock

clean:
	@rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .benchmarks .coverage
	@find flightapp sim tests missions -name __pycache__ -type d -prune -exec rm -rf {} +

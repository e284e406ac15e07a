# Everything runs in .venv inside this checkout, which is made anew when requirements.lock or pyproject.toml changes.

PYTHON ?= python3
VENV := .venv
READY := $(VENV)/.ready
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check --no-input

.PHONY: help race test soak coverage lint docs lock lock-check clean

help:
	@echo "make race      fly the five gates in simulation; the run goes to runs/"
	@echo "make test      lint, types, all tests, and the documentation"
	@echo "make soak      the tests that take long, which make test leaves out"
	@echo "make coverage  lines that the tests run, those on the wall clock left out"
	@echo "make lint      ruff and mypy only"
	@echo "make docs      the documentation as a site in build/docs; a broken link fails it"
	@echo "make lock      pin the dependencies of pyproject.toml in requirements.lock (needs uv)"
	@echo "make lock-check  look for a wheel of each pin for aarch64, as on a Jetson (needs the network)"
	@echo "make clean     remove .venv and caches; runs/ is kept"

race: $(READY)
	@$(VENV)/bin/flightapp fly missions/five_gates.py --sim

# What is judged by the wall clock has the computer to itself.
test: lint
	@$(VENV)/bin/python -m pytest --numprocesses 2 --dist loadfile -m "not wall_clock and not soak"
	@$(VENV)/bin/python -m pytest -m "wall_clock and not soak"
	@$(MAKE) --no-print-directory docs

soak: $(READY)
	@$(VENV)/bin/python -m pytest --numprocesses 2 --dist loadfile -m "soak and not wall_clock"
	@$(VENV)/bin/python -m pytest -m "soak and wall_clock"

coverage: $(READY)
	@$(VENV)/bin/python -m pytest --numprocesses 2 --dist loadfile -m "not wall_clock and not soak" \
		--cov flightapp --cov sim --cov-report term:skip-covered

lint: $(READY)
	@$(VENV)/bin/ruff check --quiet .
	@$(VENV)/bin/ruff format --check --quiet . || { echo "not formatted; mend with: $(VENV)/bin/ruff format ." >&2; exit 1; }
	@$(VENV)/bin/mypy --no-error-summary

# Not --quiet: a warning that is not logged is not counted by --strict.
docs: $(READY)
	@$(VENV)/bin/python docs/generated.py
	@NO_MKDOCS_2_WARNING=true $(VENV)/bin/python -m mkdocs build --strict --clean

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

# As on a Jetson: each pin has a wheel for aarch64 and glibc 2.28, with the hash that the lock holds.
lock-check:
	@command -v uv >/dev/null || { echo "make lock-check needs uv: pip install uv" >&2; exit 1; }
	@for version in 3.11 3.12; do \
		uv pip install --dry-run --quiet --no-config --require-hashes --no-deps --only-binary :all: \
			--python-platform aarch64-manylinux_2_28 --python-version $$version --target build/none \
			-r requirements.lock && echo "aarch64, Python $$version: a wheel for each pin" || exit 1; \
	done

clean:
	@rm -rf build $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .benchmarks .coverage
	@find flightapp sim tests missions -name __pycache__ -type d -prune -exec rm -rf {} +

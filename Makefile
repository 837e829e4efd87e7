# make run       create the environment, run the laptop campaign (CONFIG=smoke: another), say where the report is
# make test      create the environment, then run all tests
# make check     style, types and import contracts, and the fast tests (two minutes)
# make coverage  all tests, and the share of lines and branches that they run
# make env       create the environment in .venv/
# make style     check formatting, types and import contracts
# make lint      style, the workflow, and the documentation
# make docs      build the documentation in site/; a broken link is an error
# make dry-run   show what every shipped configuration would run
# make lock      pin the dependencies of pyproject.toml at the versions of the environment
# make help      show these lines

CONFIG ?= laptop
CORES ?= all
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do \
  command -v $$p >/dev/null 2>&1 && $$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null && { echo $$p; break; }; done)

.PHONY: run test check coverage env lock style lint docs dry-run help
.DEFAULT_GOAL := run

help:
	@sed -n 's/^# \(make [a-z-]* \)/\1/p' $(firstword $(MAKEFILE_LIST))

run: env
	@$(BIN)/coronaryuq run config/$(CONFIG).yaml --cores $(CORES)

test: env
	@$(BIN)/python -m pytest -m "not long" -n 2 --dist loadfile

check: style
	@$(BIN)/python -m pytest -m "not (long or slow or workflow)" -n 2 --dist loadfile -q

coverage: env
	@$(BIN)/python -m pytest -m "not long" -n 2 --dist loadfile --cov --cov-report=term:skip-covered

style: env
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/snakefmt --check workflow && $(BIN)/lint-imports && $(BIN)/mypy --num-workers 2

lint: style
	@$(BIN)/snakemake --lint --configfile config/smoke.yaml
	@$(MAKE) --no-print-directory docs

docs: env
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

dry-run: env
	@for config in config/*.yaml; do echo "== $$config"; \
	  if [ $$config = config/discrepancy.yaml ] && [ ! -d ../shared/data ]; then echo "skipped: its measurements, ../shared/data, are not here"; continue; fi; \
	  $(BIN)/snakemake --configfile $$config --cores 2 -n --quiet all || exit 1; done

env: $(READY)

$(READY): envs/requirements.lock pyproject.toml
	@test -n "$(PYTHON)" || { echo "make: Python 3.11, 3.12 or 3.13 is needed and none was found: apt-get install python3 (Debian 12, Ubuntu 24.04), or name one: make PYTHON=/path/to/python3.11"; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "make: $(PYTHON) cannot make environments: apt-get install python3-venv"; exit 2; }
	@echo "Making the environment in $(VENV)/ (a few minutes, once)"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check "$$(grep '^torch==' envs/requirements.lock)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r envs/requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@$(BIN)/coronaryuq doctor --environment
	@touch $(READY)

# After a change of the dependencies in pyproject.toml, in an environment that has them.
lock:
	@$(BIN)/python tools/lock.py pyproject.toml envs/requirements.lock

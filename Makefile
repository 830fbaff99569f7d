.PHONY: setup run test suite lint bench fuzz clean
VENV := .venv
STAMP := $(VENV)/.ready
PYTHON ?= python3
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

setup: $(STAMP)

$(STAMP): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "deckflex needs Python 3.11 or newer")'
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $(STAMP)

run: setup
	mkdir -p out
	$(VENV)/bin/deckflex run logs/sample.mcap -o out/sample.mcap --rrd out/sample.rrd

lint: setup
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy

test: setup
	$(MAKE) --jobs=2 lint suite

suite: setup
	$(VENV)/bin/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

bench: setup
	$(VENV)/bin/python -m benchmarks

fuzz: setup
	$(VENV)/bin/python -m tests.fuzz --seconds $(or $(SECONDS),60)

clean:
	rm -rf $(VENV) out

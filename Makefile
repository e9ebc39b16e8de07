# Needs Python 3.10 or newer, make and a network. Everything lives in .venv.
PYTHON ?= python3
BIN := $(if $(filter Windows_NT,$(OS)),.venv/Scripts,.venv/bin)
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: help install demo test fast check bench extras pictures lock clean

help:
	@echo "make demo      fit a bundled sequence, print the metrics and the path of the report"
	@echo "make test      install everything and run the tests"
	@echo "make fast      the tests that take less than a minute together"
	@echo "make install   only the environment, in .venv"
	@echo "make check     lint, format, types and tests"
	@echo "make bench     the benchmark tables (rearticulate bench)"
	@echo "make extras    every extra alone in a fresh environment, every command once (a network, some GB)"
	@echo "make pictures  the pictures of the README"
	@echo "make lock      pin all dependencies anew in constraints.txt"

install: .venv/dev.stamp

demo: .venv/runtime.stamp
	$(BIN)/rearticulate demo

test: install
	$(BIN)/python -m pytest

fast: install
	$(BIN)/python -m pytest -m "not slow"

check: install
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright
	$(BIN)/python -m pytest

bench: install
	$(BIN)/rearticulate bench

extras:
	$(PYTHON) scripts/check_extras.py .venv/extras

pictures: demo install
	$(BIN)/rearticulate render demo-out -o docs/clip.gif --size 200 --overwrite
	$(BIN)/python scripts/viewer_picture.py demo-out docs/viewer.png

lock: install
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile --universal --python-version 3.10 --all-extras --no-annotate --upgrade \
		--custom-compile-command "make lock" pyproject.toml -o constraints.txt

clean:
	rm -rf .venv

.venv/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
		{ echo "error: Python 3.10 or newer is needed; try: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv .venv

.venv/runtime.stamp: pyproject.toml constraints.txt | .venv/pyvenv.cfg
	$(PIP) -e .
	@touch $@

.venv/dev.stamp: .venv/runtime.stamp
	$(PIP) -e ".[dev]"
	@touch $@

# Two commands: `make demo` runs the main job on a clip it builds itself, `make test` runs all tests. Both set up what they need.
SHELL := /bin/bash
.DEFAULT_GOAL := help
VENV := .venv
PY := $(VENV)/bin/python
DEMO := build/demo

help:
	@echo "make demo       build a clip, recover its wind, edit, bake; prints where the results are"
	@echo "make test       lint, types, all tests"
	@echo "make setup      only make $(VENV) with everything that the two need"
	@echo "make extension  build/seeing_wind-*.zip for Blender"
	@echo "make clean      remove build/"

setup: $(VENV)/.complete

$(VENV)/.complete: pyproject.toml seeing_wind/engine/requirements.txt
	@bash scripts/make_venv.sh $(VENV)
	@touch $@

demo: setup
	$(PY) sample_scenes/falling_leaf/demo.py --out $(DEMO)

lint: setup
	$(PY) -m ruff check seeing_wind tests sample_scenes scripts benchmarks docs __init__.py
	$(PY) -m mypy

test: lint
	$(PY) -m pytest

extension: setup
	@mkdir -p build
	$(PY) scripts/build_extension.py build

clean:
	rm -rf build

.PHONY: help setup demo lint test extension clean

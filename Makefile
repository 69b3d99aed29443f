# Two commands: `make demo` runs the main job on a clip it builds itself, `make test` runs all tests. Both set up what they need.
SHELL := /bin/bash
.DEFAULT_GOAL := help
VENV := .venv
PY := $(VENV)/bin/python
DEMO := build/demo

help:
	@echo "make demo       build a clip, recover its wind, edit, bake; prints where the results are"
	@echo "make test       lint, types, all tests"
	@echo "make lock       the engine's locked requirements anew"
	@echo "make quick-recover  a short clip recovered in the engine's locked environment, without bpy"
	@echo "make setup      only make $(VENV) with everything that the two need"
	@echo "make extension  build/seeing_wind-*.zip for Blender"
	@echo "make scenes     the whole job on all sample scenes, half an hour; SHORT=1 for a small one of each"
	@echo "make tables     the paper's tables, an hour or two; SHORT=1 for two rows, ROW=NAME for one"
	@echo "make benchmark-mpm  the solver's speed beside other simulators"
	@echo "make benchmark-report  what a large clip costs: shares of stages and report, memory; RUN='--size 3840 2160 --frames 100 300'"
	@echo "make screenshots SHOOT=PROGRAM  the pictures of docs/screenshots/ anew, see make.sh there"
	@echo "make clean      remove build/"

setup: $(VENV)/.complete

$(VENV)/.complete: pyproject.toml seeing_wind/engine/requirements.txt
	@bash scripts/make_venv.sh $(VENV)
	@touch $@

# The engine's own environment as Install Engine makes it: locked, without bpy.
engine-environment: .venv-engine/.complete

.venv-engine/.complete: seeing_wind/engine/requirements.lock seeing_wind/engine/torch.lock
	@bash scripts/make_engine_venv.sh .venv-engine
	@touch $@

# Newest versions that requirements.txt admits, with their hashes.
lock:
	bash scripts/lock_engine.sh

# A short clip, recovered in the engine's own environment.
quick-recover: setup engine-environment
	bash scripts/quick_recover.sh .venv-engine/bin/python build/quick_recover

demo: setup
	$(PY) sample_scenes/falling_leaf/demo.py --out $(DEMO)

# In BLENDER= if that is set, else in the one on the PATH, else in the bpy wheel.
scenes: setup
	$(PY) sample_scenes/whole_jobs.py --out build/$(if $(SHORT),short_scenes --quick,scenes)

lint: setup
	$(PY) -m ruff check seeing_wind tests sample_scenes scripts benchmarks docs __init__.py
	$(PY) -m mypy

test: lint
	$(PY) -m pytest

extension: setup
	@mkdir -p build
	$(PY) scripts/build_extension.py build

# Resumable: rows that are in build/tables are kept.
tables: setup
	@$(PY) -m pip install --quiet --disable-pip-version-check -e ".[benchmarks]"
	$(PY) benchmarks/tables.py $(if $(SHORT),--short --again,--docs) $(if $(ROW),--row $(ROW))

# The solver's speed beside other simulators'; about ten minutes on two idle cores.
benchmark-mpm: setup
	@$(PY) -m pip install --quiet --disable-pip-version-check -e ".[benchmark-mpm]"
	$(PY) benchmarks/mpm.py

# Two idle cores take about ten minutes.
benchmark-report: setup
	$(PY) benchmarks/report_share.py $(RUN)

screenshots: setup
	@[ -n "$(SHOOT)" ] || { echo "SHOOT= names a program that shows Blender's window and photographs it, see docs/screenshots/make.sh" >&2; exit 2; }
	bash docs/screenshots/make.sh $(SHOOT) $(STATE)

clean:
	rm -rf build

.PHONY: help setup engine-environment lock quick-recover demo scenes lint test extension tables benchmark-mpm benchmark-report screenshots clean

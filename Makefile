# Two commands: `make demo` runs the main job on a clip it builds itself, `make test` runs all tests. Both set up what they need.
SHELL := /bin/bash
.DEFAULT_GOAL := help
VENV := .venv
PY := $(VENV)/bin/python
ENGINE := .venv-engine
TESTS := .venv-tests
# What needs bpy. Every other test runs in the engine's environment.
BLENDER_TESTS := tests/ui tests/test_whole_job.py
# A process for each core in either suite: the two run side by side, as many tests wait for a worker that they have started. The tests of a
# file stay together, as they share fixtures. ALL=1: those marked `slow`, too. What several threads of the solver do together (CREW) is tried
# in one process that has all cores.
CREW := tests/engine/mpm/test_crew.py tests/engine/mpm/test_launches.py tests/engine/mpm/shell/test_cholesky.py
PYTEST = -m pytest -n $(shell nproc) --dist loadfile --no-loadscope-reorder --durations=25 $(if $(ALL),,-m "not slow")
DEMO := build/demo
KERNELS := $(CURDIR)/build/kernels

help:
	@echo "make demo       build a clip, recover its wind, edit, bake; prints where the results are"
	@echo "make test       lint, types, all tests: the engine's in its own locked environment, the panel's in Blender's"
	@echo "make test-all   the same with the tests that are marked slow"
	@echo "make faults     a thousand hostile inputs, two hundred kills, full disks; prints their counts"
	@echo "make lock       the locked requirements of the engine and of its tests anew"
	@echo "make quick-recover  a short clip recovered in the engine's locked environment, without bpy"
	@echo "make quick-recover-matrix  the same at the lowest and newest versions that are admitted, on Python 3.11 and 3.13"
	@echo "make setup      only make the environments that these need"
	@echo "make extension  build/seeing_wind-*.zip for Blender"
	@echo "make scenes     the whole job on all sample scenes, half an hour; SHORT=1 for a small one of each, VIDEO=1 for their videos, too"
	@echo "make tables     the paper's tables, an hour or two; SHORT=1 for two rows, ROW=NAME for one"
	@echo "make test-quadrants  the solver's tests and a quick recovery with kernels compiled by Quadrants instead of Taichi"
	@echo "make farm-test  a batch on two nodes of a Ray cluster, one killed, and its Open Job Description run by openjd-cli"
	@echo "make benchmark-mpm  the solver's speed beside other simulators"
	@echo "make benchmark-shells  how long a shell of 1,024 and of 10,000 vertices takes"
	@echo "make benchmark-compilers  Quadrants beside Taichi"
	@echo "make sensitivity  what each number of the recovery is worth: halved and doubled, one at a time; an hour"
	@echo "make docs       the documentation as a site in build/docs; a broken link, anchor or picture is an error"
	@echo "make references docs/reference/cli.md, materials.md and constants.md from the options, the material library and the constants"
	@echo "make benchmark-report  what a large clip costs: shares of stages and report, memory; RUN='--size 3840 2160 --frames 100 300'"
	@echo "make screenshots BLENDER=PROGRAM  the pictures of docs/screenshots/ anew, see make.sh there"
	@echo "make solvers BLENDER=PROGRAM  how far Blender's solvers are off a curved field, and how fast particles play in it"
	@echo "make winds      the wind library anew: thirteen winds recovered; half an hour or more on two idle cores"
	@echo "make film       build/film.mp4: clip, arrows and composite side by side, of what make demo and make scenes left"
	@echo "make clean      remove build/"

setup: $(VENV)/.complete $(TESTS)/.complete
	@bash scripts/outline_model.sh $(VENV) $(ENGINE)

$(VENV)/.complete: pyproject.toml seeing_wind/engine/requirements.txt
	@bash scripts/make_venv.sh $(VENV)
	@touch $@

# The engine's own environment as Install Engine makes it: locked, without bpy.
$(ENGINE)/.complete: seeing_wind/engine/requirements.lock seeing_wind/engine/torch.lock
	@python=$$(bash scripts/find_python.sh 3.11 3.12 3.13) && "$$python" scripts/environments.py engine $(ENGINE)
	@touch $@

# The tests' tools over it, which leave it as it is.
$(TESTS)/.complete: $(ENGINE)/.complete tests/requirements.lock
	@$(ENGINE)/bin/python scripts/environments.py tests $(TESTS) $(ENGINE)
	@touch $@

# Newest versions that requirements.txt and pyproject.toml admit, with their hashes.
lock:
	bash scripts/lock_engine.sh

# A short clip, recovered in the engine's own environment.
quick-recover: build/clip/clip.mp4 $(ENGINE)/.complete
	$(PY) scripts/quick_recover.py $(ENGINE)/bin/python build/quick_recover --clip build/clip

# Nothing that Install Engine installs, but what a package manager may give: both ends of requirements.txt.
quick-recover-matrix: build/clip/clip.mp4
	$(PY) scripts/recover_matrix.py --clip build/clip

build/clip/clip.mp4: | setup
	$(PY) sample_scenes/falling_leaf/make.py --out build/clip --frames 10 --size 320x180 --samples 4

# The worker is the engine in its own environment, as in a user's Blender.
demo scenes winds: export SEEING_WIND_PYTHON := $(CURDIR)/$(ENGINE)/bin/python

# The other compiler that the kernels run on, in an environment of its own: the engine's, with Quadrants.
QUADRANTS := .venv-quadrants

$(QUADRANTS)/.complete: seeing_wind/engine/requirements.lock seeing_wind/engine/torch.lock pyproject.toml
	@$(PY) scripts/environments.py engine $(QUADRANTS)
	@$(QUADRANTS)/bin/python -m pip install --quiet --disable-pip-version-check -e ".[quadrants]" pytest "pytest-xdist>=3.6,<4"
	@touch $@

# Ray and openjd-cli in an environment of their own, over the engine's.
FARM := .venv-farm

$(FARM)/.complete: $(ENGINE)/.complete tests/requirements.lock pyproject.toml
	@$(ENGINE)/bin/python scripts/environments.py tests $(FARM) $(ENGINE)
	@$(FARM)/bin/python -m pip install --quiet --disable-pip-version-check -e ".[farm,farm-test]"
	@touch $@

farm-test: $(FARM)/.complete
	$(FARM)/bin/python -m pytest -s tests/farm

test-quadrants: export QD_OFFLINE_CACHE_FILE_PATH := $(KERNELS)_quadrants
test-quadrants: build/clip/clip.mp4 $(QUADRANTS)/.complete
	SEEING_WIND_COMPILER=quadrants $(QUADRANTS)/bin/python -m pytest $(CREW)
	SEEING_WIND_COMPILER=quadrants $(QUADRANTS)/bin/python $(PYTEST) tests/engine/mpm $(CREW:%=--ignore=%)
	SEEING_WIND_COMPILER=quadrants $(PY) scripts/quick_recover.py $(QUADRANTS)/bin/python build/quick_recover_quadrants --clip build/clip

demo: setup
	$(PY) sample_scenes/falling_leaf/demo.py --out $(DEMO)

# In BLENDER= if that is set, else in the one on the PATH, else in the bpy wheel.
scenes: setup
	$(PY) sample_scenes/whole_jobs.py --out build/$(if $(SHORT),short_scenes --quick,scenes) $(if $(VIDEO),--video)

lint: $(VENV)/.complete
	$(PY) -m ruff check seeing_wind tests sample_scenes scripts benchmarks docs __init__.py
	$(PY) -m mypy

# Compiled once for all processes of the tests, and again after a change of the solver. What else the tests compile they add to it.
build/kernels/.complete: $(TESTS)/.complete $(wildcard seeing_wind/engine/mpm/*.py seeing_wind/engine/mpm/*/*.py seeing_wind/engine/mpm/*/*/*.py)
	@mkdir -p $(KERNELS)
	TI_OFFLINE_CACHE_FILE_PATH=$(KERNELS) $(TESTS)/bin/python tests/kernels.py
	@touch $@

test test-engine test-panel quick-recover demo scenes: export TI_OFFLINE_CACHE_FILE_PATH := $(KERNELS)
# Compiled modules are kept, also where the shell forbids it: four seconds of every process of the tests.
unexport PYTHONDONTWRITEBYTECODE

# Two lanes side by side, the engine's and the panel's, each with the environment that it needs: making one and compiling the kernels take
# one core, and so do the last tests of a suite. What the panel's lane has to say comes when it ends. A lock that a killed process left would
# keep the cache as it is for good.
test:
	@rm -f $(KERNELS)/*.lock
	@$(MAKE) --no-print-directory -j 2 test-engine test-panel

test-engine: build/kernels/.complete
	$(TESTS)/bin/python -m pytest $(CREW)
	$(TESTS)/bin/python $(PYTEST) tests $(BLENDER_TESTS:%=--ignore=%) $(CREW:%=--ignore=%)

test-panel: lint
	@mkdir -p build
	@$(PY) $(PYTEST) $(BLENDER_TESTS) > build/test-panel.log 2>&1; status=$$?; cat build/test-panel.log; exit $$status

test-all:
	$(MAKE) test ALL=1

# All hostile inputs, kills and full disks, half an hour on two idle cores; `make test` has a quick draw of each.
faults: setup
	SEEING_WIND_FAULTS=whole $(TESTS)/bin/python -m pytest -s tests/faults

extension: setup
	@mkdir -p build
	$(PY) scripts/build_extension.py build

# Resumable: rows that are in build/tables are kept.
tables: setup
	@$(PY) -m pip install --quiet --disable-pip-version-check -e ".[benchmarks]"
	$(PY) benchmarks/paper_tables/tables.py $(if $(SHORT),--short --again,--docs) $(if $(ROW),--row $(ROW))

# The solver's speed beside other simulators'; about ten minutes on two idle cores.
benchmark-mpm: setup
	@$(PY) -m pip install --quiet --disable-pip-version-check -e ".[benchmark-mpm]"
	$(PY) benchmarks/speed/mpm.py

benchmark-shells: setup
	PYTHONPATH=$(CURDIR) $(ENGINE)/bin/python benchmarks/speed/shell_speed.py

# What each number of the recovery is worth, on TRUTH="one.npz two.npz"; some seconds per number, file and factor. Resumable.
sensitivity: setup
	PYTHONPATH=$(CURDIR) $(ENGINE)/bin/python benchmarks/accuracy/sensitivity.py $(or $(TRUTH),tests/engine/recovery/genesis_post.npz) $(RUN)

# The solver's two compilers; a quarter of an hour on two idle cores.
benchmark-compilers: setup
	@$(PY) -m pip install --quiet --disable-pip-version-check -e ".[quadrants]"
	$(PY) benchmarks/speed/compilers.py

# The pages that are generated. `cli-reference` alone writes the first.
references: cli-reference
	$(PY) scripts/materials_reference.py
	$(PY) scripts/constants_reference.py

cli-reference: setup
	$(PY) scripts/cli_reference.py

# MkDocs in an environment of its own: the versions that pyproject.toml pins, nothing of the engine.
DOCS := .venv-docs

$(DOCS)/.complete: pyproject.toml
	@python=$$(bash scripts/find_python.sh 3.11 3.12 3.13) && "$$python" -m venv $(DOCS)
	@$(DOCS)/bin/python -m pip install --quiet --disable-pip-version-check $$($(DOCS)/bin/python -c \
	  'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["docs"])')
	@touch $@

docs: $(DOCS)/.complete
	NO_MKDOCS_2_WARNING=1 $(DOCS)/bin/mkdocs build --strict --clean
	@echo "build/docs/index.html"

# Two idle cores take about ten minutes.
benchmark-report: setup
	$(PY) benchmarks/speed/report_share.py $(RUN)

screenshots: setup
	@[ -n "$(BLENDER)" ] || { echo "BLENDER= names a Blender of which a window can be shown and photographed, see docs/screenshots/make.sh" >&2; exit 2; }
	bash docs/screenshots/make.sh $(BLENDER) $(SHOTS)

solvers:
	@[ -n "$(BLENDER)" ] || { echo "BLENDER= names the Blender whose solvers are measured" >&2; exit 2; }
	$(BLENDER) -b --factory-startup --python-exit-code 9 --python tests/blender/playback_check.py

# The library of winds that the extension carries, and the films of what `make demo` and `make scenes` left.
winds: setup
	$(PY) sample_scenes/winds/make.py --out seeing_wind/ui/field/library/winds --takes build/wind_takes

film: setup
	$(PY) sample_scenes/film.py --demo $(DEMO) --scenes build/scenes --out build/film.mp4

clean:
	rm -rf build

.PHONY: help docs references sensitivity setup lock quick-recover quick-recover-matrix demo scenes lint test test-engine test-panel test-all farm-test test-quadrants faults extension tables benchmark-mpm benchmark-shells benchmark-compilers benchmark-report cli-reference screenshots solvers winds film clean

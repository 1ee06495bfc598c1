# Every target first sees to .venv: made, or made anew when it is incomplete or out of date.
PYTHON ?= python3
PROFILE ?= quick
# Processes that run the tests; 0 runs them in pytest's own.
WORKERS ?= 2
# An index that has CPU builds of torch; needed on Linux only, see environment.md.
TORCH_INDEX ?=

BIN := .venv/bin
export PYOPENGL_PLATFORM ?= egl
export TORCH_INDEX
# Else each process would compile thousands of modules of .venv anew: seconds each.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help setup reproduce results test test-all test-processors lab site lint format lock clean profile

help:
	@echo "make reproduce        the paper's evaluation, figures and notebooks (PROFILE=quick or paper)"
	@echo "make results          reported figures again: did any move? (NAMES=missions, or all; none: which there are)"
	@echo "make test             lint, types and the fast tests"
	@echo "make test-all         lint, types and every test at full counts"
	@echo "make test-processors  the tests that rest on recognition, as other processors would"
	@echo "make lab              open the notebooks in JupyterLab"
	@echo "make site             documents, notebooks and figures as one static site, in build/site"
	@echo "make lint             check style and types"
	@echo "make format           mend style"
	@echo "make setup            only make .venv and check the system libraries"
	@echo "make lock             pin the newest versions that pyproject.toml allows (needs uv)"
	@echo "make clean            remove what was built, .venv aside"

setup:
	@command -v "$(PYTHON)" >/dev/null || { echo "No $(PYTHON) here: VRChain needs Python 3.11 or 3.12 (sudo apt-get install python3 python3-venv), or make PYTHON=/path/to/python3" >&2; exit 1; }
	@"$(PYTHON)" tools/setup.py

profile:
	@case "$(PROFILE)" in quick|paper) ;; *) echo "PROFILE is quick or paper, not '$(PROFILE)': make reproduce PROFILE=paper" >&2; exit 2;; esac

reproduce: profile setup
	$(BIN)/vrchain reproduce --profile $(PROFILE)

# NAMES: of figures in figures/results.csv, as they begin; all takes days. None: what there is.
results: setup
	$(BIN)/python tools/results.py $(NAMES)

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

test: lint
	$(BIN)/pytest -m "not slow" -n $(WORKERS) --dist worksteal

test-all: lint
	$(BIN)/pytest -n $(WORKERS) --dist worksteal --hypothesis-profile=full

# PROCESSORS: some of this, AVX2 and SSE4; TESTS: files, in place of all of recognition's.
test-processors: setup
	WORKERS=$(WORKERS) $(BIN)/python tools/processors.py $(PROCESSORS) -- $(TESTS)

# tools/jupyter: no dialog that asks for a build, for which nothing here has need.
lab: setup
	JUPYTER_CONFIG_PATH="$(CURDIR)/tools/jupyter$${JUPYTER_CONFIG_PATH:+:$$JUPYTER_CONFIG_PATH}" $(BIN)/jupyter lab notebooks

# Of what `make reproduce` has made. SITE_PYTHON: one with mkdocs-material and nbconvert.
SITE_PYTHON ?= $(BIN)/python
site: profile setup
	$(SITE_PYTHON) tools/site/build.py $(PROFILE)

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

lock:
	uv lock --quiet --upgrade
	uv export --quiet --locked --all-extras --no-emit-project --no-emit-package torch --format requirements.txt -o requirements.lock

clean:
	rm -rf build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -not -path './.venv/*' -exec rm -rf {} +

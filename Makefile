# softcal. `make help` lists the targets. All is installed into .venv beside this file.
# On first use: python3 -m venv, then uv, which takes a fifth of pip's time, and pip where uv fails;
# later only when pyproject.toml has changed. (--no-compile: Python compiles what is imported.)

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
LOWEST := .venv-lowest
# uv does not read pip's settings: where they name another index than PyPI, it is told.
INDEX = $(shell $(PYTHON) -m pip config list 2> /dev/null | sed -n "s/.*\.index-url='\(.*\)'/\1/p" | head -1)
UV = $(if $(INDEX),UV_DEFAULT_INDEX='$(INDEX)') $(BIN)/uv
PYTEST_ARGS ?=

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help study compile compile-lowest checks test test-quick test-study test-all test-lowest lint types bench bench-fe bench-inference verify-fe verify-data verify-dic verify-inference baseline clean
VERIFY_ARGS ?=

# One thread a process: the runs are spread over processes, and sums come in one order.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
# Where a machine forbids to keep compiled modules, each process compiles all that it imports: 10 s.
unexport PYTHONDONTWRITEBYTECODE

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 18

$(INSTALLED): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "softcal needs Python 3.11 or newer; name it, e.g.: make PYTHON=python3.12")'
	@$(BIN)/python -m pip --version > /dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile 'uv>=0.5'
	$(UV) pip install --python $(BIN)/python --editable '.[dev,dask]' \
	  || { echo "uv could not install; pip tries" >&2; \
	    $(BIN)/python -m pip install --disable-pip-version-check --no-compile --editable '.[dev,dask]'; }
	@touch $@

study: $(INSTALLED)  ## calibrate on the real forces of the thesis (study thesis-forces)
	$(BIN)/calib run thesis-forces

compile: $(INSTALLED)  ## compile the kernels of FE models and image correlation, which the tests' processes would do side by side
	$(BIN)/python tests/compile_kernels.py

test: compile  ## run the tests, the study of the thesis and the notebooks among them (some 20 minutes)
	$(MAKE) --no-print-directory -j2 test-quick test-study

test-quick: $(INSTALLED)  ## the part of `make test` without the study of the thesis
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow and not study" $(PYTEST_ARGS)

# A study keeps one core busy for most of its time, so that it runs beside the quick tests.
test-study: $(INSTALLED)  ## the part of `make test` that runs the study of the thesis
	$(BIN)/python -m pytest -m "study and not slow" $(PYTEST_ARGS)

test-all: $(INSTALLED)  ## run all tests, long statistical ones too
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not study" $(PYTEST_ARGS)
	$(BIN)/python -m pytest -m study $(PYTEST_ARGS)

checks: $(INSTALLED)
	$(MAKE) --no-print-directory lint types

lint: $(INSTALLED)  ## check style and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED)  ## check types
	$(BIN)/mypy

bench: $(INSTALLED)  ## time one FE run of each hypothesis and the emulator
	$(BIN)/python -m benchmarks.stages

bench-fe: $(INSTALLED)  ## time the FE model beside the thesis, FElupe and CalculiX (some 8 minutes)
	$(BIN)/python benchmarks/fe.py $(if $(JSON),--json $(JSON))

verify-fe: $(INSTALLED)  ## measure docs/verification/fe.json (hours; VERIFY_ARGS="--only gci" for a part)
	$(BIN)/python -m benchmarks.verify_fe $(VERIFY_ARGS)

verify-data: $(INSTALLED)  ## measure docs/verification/data.json (three quarters of an hour; SOFTCAL_DATA names the real files)
	$(BIN)/python -m benchmarks.verify_data $(VERIFY_ARGS)

verify-inference: $(INSTALLED)  ## measure docs/verification/inference.json (hours; VERIFY_ARGS="--only sbc" for a part)
	$(BIN)/python -m benchmarks.verify_inference $(VERIFY_ARGS)

bench-inference: $(INSTALLED)  ## time log-probabilities, samplers and a study (numpyro: extra benchmark)
	$(BIN)/python benchmarks/inference.py $(if $(JSON),--json $(JSON))

baseline: $(INSTALLED)  ## renew the stored posteriors that a test compares with, and say what moved
	$(BIN)/python tests/posterior_baseline.py

verify-dic: $(INSTALLED)  ## measure docs/verification/dic.json (half an hour; SOFTCAL_DATA names the real images)
	$(BIN)/python -m benchmarks.verify_dic $(VERIFY_ARGS)

$(LOWEST)/.installed: pyproject.toml $(INSTALLED)
	$(UV) venv --quiet --clear --python 3.11 $(LOWEST)
	$(UV) pip install --quiet --python $(LOWEST)/bin/python --resolution lowest-direct --editable '.[dev,dask]'
	@touch $@

# Compiled kernels of one version of numba take the place of another's, so that each has a folder;
# they run for seconds, so that most of what the compiler can do to them does not pay.
compile-lowest: $(LOWEST)/.installed  ## compile the kernels on the oldest versions pyproject.toml allows
	NUMBA_OPT=1 NUMBA_CACHE_DIR="$(CURDIR)/$(LOWEST)/kernels" $(LOWEST)/bin/python tests/compile_kernels.py

test-lowest: compile-lowest  ## run tests of a few seconds each on the oldest versions pyproject.toml allows
	NUMBA_OPT=1 NUMBA_CACHE_DIR="$(CURDIR)/$(LOWEST)/kernels" $(LOWEST)/bin/python -m pytest -n 2 --dist worksteal -m "not slow and not study and not notebook and not lasting" --ignore-glob='tests/test_benchmarks_*' --ignore-glob='tests/test_house_*' $(PYTEST_ARGS)

clean:  ## remove environments and caches; runs/ is kept
	rm -rf $(VENV) $(LOWEST) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

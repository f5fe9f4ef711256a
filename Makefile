# make demo        the whole pipeline on a small set the project makes itself
# make demo-physics   a hidden effect is found and added; ends with a report
# make bench-physics  the missing-physics benchmark; goes on where it stopped
# make test        what CI runs: style, types, tests
# make bench       speed; writes docs/results/bench.json
# make reproduce DATA=<folder> PROFILE=cpu|cpu-recordings|paper    the nine DiSECt environments, from raw recordings to the table
# make setup       everything the others need; they call it
# make system-libs the system libraries, on Debian and Ubuntu, as root

PYTHON ?= python3
VENV ?= .venv
PROFILE ?= cpu
TORCH_FLAGS ?=
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PIP := $(BIN)/python -m pip install -qq --disable-pip-version-check
SYSTEM_LIBS := libusb-1.0-0 libx11-6 libgl1 libegl1 libgomp1

.PHONY: setup demo demo-physics test bench bench-physics reproduce system-libs clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt scripts/check_machine.py
	@$(PYTHON) scripts/check_machine.py
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing torch, then everything else (some minutes the first time)"
	@$(PIP) $(TORCH_FLAGS) -c constraints.txt torch
	@$(PIP) -c constraints.txt -e ".[dev,disect]"
	@touch $@

demo: setup
	$(BIN)/plop demo -w demo

demo-physics: setup
	$(BIN)/plop demo-physics -w demo-physics

test: setup
	$(BIN)/ruff check .
	$(BIN)/mypy
	OMP_NUM_THREADS=1 $(BIN)/pytest -q

bench: setup
	$(BIN)/python -m benchmarks

bench-physics: setup
	@$(PIP) -c constraints.txt -e ".[bench]"
	$(BIN)/python -m benchmarks.physics_cameras --minutes 150
	$(BIN)/python -m benchmarks.physics_points --minutes 90
	$(BIN)/python -m benchmarks.physics_overview

reproduce: setup
	@test -n "$(DATA)" || { echo "usage: make reproduce DATA=<folder of DiSECt recordings> PROFILE=cpu|cpu-recordings|paper" >&2; exit 2; }
	$(BIN)/plop reproduce "$(DATA)" --profile $(PROFILE) -w reproduce

system-libs:
	apt-get update -qq
	DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $(SYSTEM_LIBS)

clean:
	rm -rf $(VENV) build *.egg-info .pytest_cache .mypy_cache .ruff_cache

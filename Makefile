# make demo        the whole pipeline on a small set the project makes itself
# make demo-physics   a hidden effect is found and added; ends with a report
# make bench-physics  the missing-physics benchmark; goes on where it stopped
# make test        what CI runs: style, types, tests
# make docs        the documentation, built strictly into build/site
# make bench       speed; writes docs/results/bench.json
# make reproduce DATA=<folder> PROFILE=cpu|cpu-recordings|paper [SCHEDULER=tcp://HOST:8786]    the nine DiSECt environments, from raw recordings to the table
# make setup       everything `make demo` needs; the others add what they need themselves

PYTHON ?= python3
VENV ?= .venv
PROFILE ?= cpu
# torch's build: cpu, auto (what fits this machine's GPU), cu128, ...; TORCH_FLAGS="--index-url ..." takes it from an index of your own
TORCH ?= cpu
TORCH_FLAGS ?=
WORKERS ?= $(shell n=$$(nproc 2>/dev/null || echo 2); echo $$((n < 8 ? n : 8)))
UV ?= $(shell command -v uv 2>/dev/null)
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
, := ,
PIP := $(BIN)/python -m pip install -qq --no-compile --disable-pip-version-check -c constraints.txt
# uv, where it is there, is faster; it does not read pip's configuration, so that pip is asked when uv finds something missing
install = $(if $(UV),$(UV) pip install -q --python $(BIN)/python -c constraints.txt $(1) || { echo "uv could not: asking pip"; $(PIP) $(1); },$(PIP) $(1))

.PHONY: setup demo demo-physics test docs bench bench-physics reproduce clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt scripts/check_machine.py scripts/install_torch.sh plop/system_libraries.py
	@$(PYTHON) scripts/check_machine.py
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing torch and the rest into $(VENV) (about a minute the first time)"
	@$(if $(TORCH_FLAGS),$(PIP) $(TORCH_FLAGS) torch,scripts/install_torch.sh $(BIN)/python $(TORCH))
	@$(call install,-e .)
	@touch $@

$(STAMP)-dev: $(STAMP)
	@echo "installing what the tests need"
	@$(call install,-e ".[dev$(,)disect]")
	@touch $@

$(STAMP)-docs: $(STAMP)
	@echo "installing what the documentation needs"
	@$(call install,-e ".[docs]")
	@touch $@

$(STAMP)-disect: $(STAMP)
	@$(call install,-e ".[disect]")
	@touch $@

demo: setup
	$(BIN)/plop demo -w demo

demo-physics: setup
	$(BIN)/plop demo-physics -w demo-physics

# one process a core, each with one thread; a file's tests stay together, since its fixtures are made once
test: $(STAMP)-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	OMP_NUM_THREADS=1 $(BIN)/pytest -q -n $(WORKERS) --dist loadfile --durations 20

# pages, links, anchors and the list of changes: a warning is an error (and --quiet would not count it)
docs: $(STAMP)-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	$(BIN)/towncrier build --draft --version next > build/changes.md

bench: setup
	$(BIN)/python -m benchmarks.speed

bench-physics: setup
	@$(call install,-e ".[worlds]")
	$(BIN)/python -m benchmarks.missing_physics run --minutes 240 --worlds own,mujoco,drake,cameras
	$(BIN)/python -m benchmarks.missing_physics score

reproduce: $(STAMP)-disect
	@test -n "$(DATA)" || { echo "usage: make reproduce DATA=<folder of DiSECt recordings> PROFILE=cpu|cpu-recordings|paper" >&2; exit 2; }
	$(BIN)/plop reproduce "$(DATA)" --profile $(PROFILE) -w reproduce $(if $(SCHEDULER),--scheduler $(SCHEDULER))

clean:
	rm -rf $(VENV) build *.egg-info .pytest_cache .mypy_cache .ruff_cache

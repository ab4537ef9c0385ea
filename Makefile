# Needs python3 (3.11 or newer), git and make; everything else goes into .venv by itself.

PYTHON ?= python3
BIN := .venv/bin
GOAL ?= 4,3
SCENARIO ?= default
FLY ?= --goal $(GOAL) --sim $(SCENARIO)

# Where `make barn` keeps its rows; begun again it goes on.
CAMPAIGN ?= campaigns/barn

# Processes of the tests. Integration tests come after the others: they fly in wall-clock time.
JOBS ?= 2
# Files that take longest first: their order stays, or those of many short tests came first.
QUICK := $(addprefix tests/,architecture unit/autonomy unit/hal unit/configs contract paper)
# Fly all the same: every command of every README, landings, flights that are looked back at.
FLYING := $(addprefix --ignore=tests/,architecture/test_readme_commands.py unit/autonomy/test_in_flight.py unit/autonomy/review)

.DEFAULT_GOAL := help
.PHONY: help setup fly kernels test test-fast coverage conformance test-browser check format bench barn paper mutation clean

help: ## show this
	@awk -F':.*## ' '/^[a-z-]+:.*## / { printf "  make %-13s %s\n", $$1, $$2 }' Makefile

setup: .venv/.dev ## the environment that checks and tests need, and nothing else

fly: .venv/.core ## a simulated flight, from nothing: make fly [GOAL=4,3] [SCENARIO=default]
	$(BIN)/autonomy fly $(FLY)

kernels: .venv/.dev ## compile what flies, so that tests beside each other do not all do it
	$(BIN)/python -m autonomy.warm

test: .venv/.dev ## the whole suite: unit, contract, paper, architecture, scenario, integration, browser
	$(BIN)/python -m tools.chromium
	$(BIN)/python -m pytest -q -n $(JOBS) --dist loadfile -m "not integration and not browser" tests
	$(BIN)/python -m pytest -q -n $(JOBS) --dist loadfile -m integration tests
	$(BIN)/python -m pytest -q -m browser tests/browser

test-fast: .venv/.dev ## what needs no flight: unit but for tools, contract, paper, architecture
	$(BIN)/python -m pytest -q -n $(JOBS) --dist loadfile --no-loadscope-reorder -m "not integration" $(FLYING) $(QUICK)

coverage: .venv/.dev ## lines and branches of autonomy and hal that no test runs; fails below 90 %
	$(BIN)/python -m pytest -q -n $(JOBS) --dist loadfile -m "not integration and not browser" --cov --cov-report=term:skip-covered tests

conformance: .venv/.dev ## measured PX4 beside the mock, or beside a PX4: make conformance [CONNECTION=udpin://0.0.0.0:14540]
	$(BIN)/python -m pytest -q --deviations $(if $(CONNECTION),--connection $(CONNECTION)) $(CONFORMANCE) tests/conformance

test-browser: .venv/.dev ## the service's page in a real browser: Debian's chromium, installed when root
	$(BIN)/python -m tools.chromium
	$(BIN)/python -m pytest -q -m browser tests/browser

check: .venv/.dev ## lint, format, types, layers
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: .venv/.dev ## rewrite the sources in the house style
	$(BIN)/ruff check --fix-only .
	$(BIN)/ruff format .

bench: .venv/.dev ## measure flights and planners, renew tools/bench/README.md [BARN=folder]
	$(BIN)/python -m pip install -q --prefer-binary -e ".[dev,bench]"
	$(BIN)/python -m tools.bench all --write $(if $(BARN),--barn $(BARN))

barn: .venv/.dev ## fly all BARN worlds, kept in CAMPAIGN: make barn BARN=folder [CAMPAIGN=campaigns/barn]
	@test -n "$(BARN)" || { echo "name the folder with BARN's worlds.json: make barn BARN=folder"; exit 2; }
	$(BIN)/python -m tools.bench fly $(CAMPAIGN) --world barn:all --barn $(BARN) --planner t3drm-rolling --seeds 3
	$(BIN)/python -m tools.bench report $(CAMPAIGN) --html $(CAMPAIGN)/report.html --markdown $(CAMPAIGN)/report.md

paper: .venv/.dev ## the paper's Tables 4 to 7 again, renew tools/bench/paper/README.md [FLIGHTS=N over MAVSDK]
	$(BIN)/python -m tools.bench.paper --write $(if $(FLIGHTS),--flights $(FLIGHTS)) $(if $(ROWS),--rows $(ROWS))

mutation: .venv/.dev ## does the suite notice wrong signs and comparisons? [TARGET="direction speed"]
	$(BIN)/python -m pip install -q --prefer-binary -e ".[dev,mutation]"
	$(BIN)/python -m tools.mutation $(TARGET)

clean: ## remove the environment and everything that was generated
	rm -rf .venv build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find autonomy hal tools tests configs -name __pycache__ -prune -exec rm -rf {} +

# Stamps: pip runs again only when what is to be installed has changed.
.venv/.core: pyproject.toml tools/bootstrap.py
	$(PYTHON) tools/bootstrap.py core
	@touch $@

.venv/.dev: pyproject.toml tools/bootstrap.py
	$(PYTHON) tools/bootstrap.py dev
	@touch .venv/.core $@

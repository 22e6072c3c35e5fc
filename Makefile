# Two commands serve a fresh machine: `make demo` and `make test`.  Both set up .venv first, and only when something changed.
VENV := .venv
BIN := $(VENV)/bin
ON_ALL_CORES := -n logical --maxprocesses 8 --dist worksteal # each file's tests mostly in one process, for the fixtures they share

.PHONY: help setup test test-slow test-hours lint demo docs bench browser report-bundle package release-check clean
.DEFAULT_GOAL := help

help: ## list what can be made
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-10s %s\n", $$1, $$2}'

setup: $(VENV)/.ready ## create .venv with everything in it
	@:

$(VENV)/.ready: pyproject.toml constraints.txt scripts/setup
	@scripts/setup $(VENV)
	@touch $@

lint: setup ## ruff, mypy strict, import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy benchmarks/*.py examples/*.py
	$(BIN)/lint-imports --no-logo

test: lint ## lint, and the quick tests
	$(BIN)/pytest $(ON_ALL_CORES) -m "not slow"

test-slow: setup ## the tests that take longer: recorded drives, packaging
	$(BIN)/pytest $(ON_ALL_CORES) -m "slow and not hours"

test-hours: setup ## thousands of mutated files for every reader, hundreds of full disks, kills and vanishing inputs
	$(BIN)/pytest -m hours

demo: setup ## simulate two robots, merge them with the wireless filter off and on
	$(BIN)/wiclosure demo --out results/demo --overwrite

docs: setup ## the site, strictly, into build/docs
	$(BIN)/sphinx-build -b html -W --keep-going -q docs build/docs
	@echo "open build/docs/index.html"

BENCHMARKS := startup pointcloud2 odometry raycast simulation drift alignment filter front_end back_end report
bench: setup ## every benchmark (an hour or two)
	@for name in $(BENCHMARKS); do echo "== $$name"; $(BIN)/python benchmarks/$$name.py || exit 1; done

browser: ## chromium, in which the report is tested, where apt may install it
	@command -v chromium chromium-browser google-chrome >/dev/null || scripts/need-packages chromium

report-bundle: ## build what draws the report's page again (needs node)
	cd pipeline/report/html/source && npm install --no-package-lock --no-audit --no-fund && npm run build

package: setup ## wheel and sdist into dist/
	$(BIN)/python -m build --outdir dist .

release-check: ## build, install the wheel into an empty environment, run the demo from it
	@scripts/release-check

clean: ## remove what was made, also .venv
	rm -rf $(VENV) build dist results src/*.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

# make demo and make test do all the set-up on a fresh Debian 12, each by itself; see CONTRIBUTING.md.
SHELL := /bin/bash
.DEFAULT_GOAL := help
BIN := .venv/bin
BUILD := build
HOBART := examples/hobart
# QGIS without a desktop; its runtime directory must be private.
QGIS_ENV := QT_QPA_PLATFORM=offscreen XDG_RUNTIME_DIR=$${XDG_RUNTIME_DIR:-$(CURDIR)/$(BUILD)/runtime} PATH=$(CURDIR)/$(BIN):$$PATH
PYTEST := $(BIN)/python -m pytest

.PHONY: help
help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' Makefile | sed -E 's/^([a-z-]+):[^#]*## */  make \1\t/' | expand -t 20

.PHONY: set-up set-up-test
set-up:  ## install what the command line needs
	@scripts/set_up.sh run
set-up-test:  ## install what the tests need, QGIS included
	@scripts/set_up.sh test

.PHONY: demo
demo: set-up  ## triangulate the Hobart block and print its check points
	$(BIN)/hrsi triangulate $(foreach n,1 2 3,$(HOBART)/hobart_ikonos_$(n)_RPC.TXT) \
	  --gcps $(HOBART)/hobart_ground_points.csv --image-points $(HOBART)/hobart_image_points.csv --height-datum ellipsoidal --tie-points none \
	  --gcp-ids H003,H022,H024,H035,H048,H058,H077,H098,H103,H105 --model shift \
	  --output-dir $(BUILD)/demo --overwrite

.PHONY: lint
lint: set-up-test  ## ruff, and mypy on the engine
	@echo "lint: ruff and mypy"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check . || { echo "make format mends this"; exit 1; }
	@$(BIN)/mypy hrsi_engine

.PHONY: format
format: set-up-test  ## bring the code into ruff's format
	@$(BIN)/ruff check --fix --quiet .; $(BIN)/ruff format .

.PHONY: test
test: set-up-test lint  ## lint, then the whole test suite, QGIS included (two runs of pytest)
	@install -d -m 700 $(BUILD)/runtime
	@echo "test: inside QGIS, then all the others; they end with a summary each"
	@status=0; \
	$(QGIS_ENV) $(PYTEST) tests/qgis || status=$$?; \
	$(PYTEST) -p no:pytest_qgis --ignore=tests/qgis tests || status=$$?; \
	exit $$status

.PHONY: fuzz
fuzz: set-up-test  ## the property-based tests with many more examples; takes long
	$(PYTEST) -p no:pytest_qgis --ignore=tests/qgis --hypothesis-profile=fuzz -m fuzz tests

.PHONY: benchmarks
benchmarks: set-up-test  ## accuracy and speed figures
	@for script in benchmarks/*.py; do echo "== $$script"; $(BIN)/python $$script || exit; done

.PHONY: clean
clean:  ## remove the environment and everything made here
	rm -rf .venv $(BUILD) dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .qgis-settings
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

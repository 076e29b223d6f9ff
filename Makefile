# make demo and make test do all the set-up on a fresh Debian 12, each by itself; see CONTRIBUTING.md.
SHELL := /bin/bash
.DEFAULT_GOAL := help
BIN := .venv/bin
BUILD := build
HOBART := examples/hobart
IMAGES := $(BUILD)/demo-images
# QGIS without a desktop; its runtime directory must be private.
QGIS_ENV := QT_QPA_PLATFORM=offscreen XDG_RUNTIME_DIR=$${XDG_RUNTIME_DIR:-$(CURDIR)/$(BUILD)/runtime} PATH=$(CURDIR)/$(BIN):$$PATH
PYTEST := $(BIN)/python -m pytest
# Tests start hundreds of programs: compiled modules are kept, also where the environment forbids it.
export PYTHONDONTWRITEBYTECODE :=
# Processor time of all that make has run, and of the shell of this line; $(1) is the last of it.
tell_processor_time = cat /proc/$$PPID/stat /proc/$$$$/stat 2>/dev/null | \
	awk '{ticks += $$16 + $$17} END {printf "processor time so far: %.1f minutes (after $(1))\n", ticks / 6000}'

.PHONY: help
help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' Makefile | sed -E 's/^([a-z-]+):[^#]*## */  make \1\t/' | expand -t 20

.PHONY: set-up set-up-test
set-up:  ## install what the command line needs
	@scripts/set_up.sh run
set-up-test:  ## install what the tests need, QGIS included
	@scripts/set_up.sh test

.PHONY: demo demo-hobart demo-images
demo: demo-hobart demo-images  ## the two tutorials: Hobart with measured points, and simulated images up to orthoimages
demo-hobart: set-up
	$(BIN)/hrsi triangulate $(foreach n,1 2 3,$(HOBART)/hobart_ikonos_$(n)_RPC.TXT) \
	  --gcps $(HOBART)/hobart_ground_points.csv --image-points $(HOBART)/hobart_image_points.csv --height-datum ellipsoidal --tie-points none \
	  --gcp-ids H003,H022,H024,H035,H048,H058,H077,H098,H103,H105 \
	  --output-dir $(BUILD)/demo --overwrite
demo-images: set-up
	$(BIN)/hrsi simulate --images 3 --along=-12,0,12 --size 1200 --gcps 6 --checks 20 --ties 0 --relief 60 \
	  --output-dir $(IMAGES)/block --overwrite
	$(BIN)/hrsi triangulate $(foreach n,1 2 3,$(IMAGES)/block/image_$(n).tif) \
	  --gcps $(IMAGES)/block/ground_points.csv --image-points $(IMAGES)/block/image_points.csv \
	  --dem $(IMAGES)/block/dem.tif --height-datum ellipsoidal --output-dir $(IMAGES)/triangulated --overwrite
	$(BIN)/hrsi orthorectify $(foreach n,1 2 3,$(IMAGES)/block/image_$(n).tif) --dem $(IMAGES)/block/dem.tif \
	  --output-dir $(IMAGES)/ortho-before --overwrite
	$(BIN)/hrsi orthorectify $(foreach n,1 2 3,$(IMAGES)/triangulated/image_$(n).tif) --dem $(IMAGES)/block/dem.tif \
	  --output-dir $(IMAGES)/ortho --overwrite
	$(BIN)/hrsi ortho-check $(foreach n,1 2 3,$(IMAGES)/ortho/image_$(n)_ortho.tif) --before $(IMAGES)/ortho-before \
	  --output-dir $(IMAGES)/check --overwrite

.PHONY: lint
lint: set-up-test  ## ruff, mypy, docstrings and names of the API, words of all texts, the plugin's readiness for Qt 6
	@echo "lint: ruff, mypy, numpydoc, flake8-qgis, enumerations"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check . || { echo "make format mends this"; exit 1; }
	@mkdir -p $(BUILD)/typing && ln -sfn $(CURDIR) $(BUILD)/typing/hrsi  # modules have names in a clone of any name
	@cd $(BUILD)/typing && MYPYPATH=. $(CURDIR)/$(BIN)/mypy --explicit-package-bases --config-file hrsi/pyproject.toml hrsi/hrsi_engine hrsi/processing_algorithms hrsi/plugin
	@$(BIN)/python scripts/check_docstrings.py
	@$(BIN)/python scripts/check_names.py
	@$(BIN)/python scripts/check_words.py
	@$(BIN)/python scripts/list_thresholds.py --check
	@$(BIN)/flake8 --isolated --select QGS1,QGS4 --extend-ignore QGS105 plugin  # QGS105: qgis_process has no iface
	@$(BIN)/python scripts/check_qt6.py plugin
	@$(call tell_processor_time,set-up and lint)

.PHONY: scan
scan: set-up-test  ## what the plugin repository's scan finds in the plugin's zip (bandit, detect-secrets, flake8)
	@$(BIN)/python scripts/scan_plugin.py

.PHONY: format
format: set-up-test  ## bring the code into ruff's format
	@$(BIN)/ruff check --fix --quiet .; $(BIN)/ruff format .

# Tests that prove something with many blocks, images, processes or kinds; pyproject.toml says what each marker means.
# A plain test beside them in `make test` shows that the feature works.
LONG := coverage or rendered or killed or wrong_inputs or real or programs or large or thorough
# Inside QGIS, then all the others on all cores; $(1) selects. QGIS's window (test-desktop) needs a quiet machine.
run_tests = install -d -m 700 $(BUILD)/runtime; status=0; \
	$(QGIS_ENV) $(PYTEST) $(1) tests/qgis || status=$$?; $(call tell_processor_time,the tests inside QGIS); \
	$(PYTEST) -p no:pytest_qgis --numprocesses auto --dist loadfile --ignore=tests/qgis --ignore=tests/desktop $(1) tests || status=$$?; \
	$(call tell_processor_time,all tests); exit $$status

.PHONY: test test-all
test: set-up-test lint  ## lint, then the tests of every feature, QGIS included, in 15 minutes of processor time
	@echo "test: inside QGIS, then all the others; they end with a summary each. make test-all has the long ones too"
	@$(call run_tests,-m "not ($(LONG))")
test-all: set-up-test lint scan speed-guard  ## lint, the scan of the zip, the speed, and all tests, also the long ones: nightly, and what CI runs
	@echo "test-all: inside QGIS, then all the others; they end with a summary each"
	@$(call run_tests,)

.PHONY: speed-guard
speed-guard: set-up-test  ## whether a command has become slower than recorded in benchmarks/speed_guard.csv
	@$(BIN)/python benchmarks/speed_guard.py

.PHONY: first-contact
first-contact: set-up-test  ## init and run on folders as people have them, simulated and real: roles, exit codes, verdicts, true errors
	@$(PYTEST) -p no:pytest_qgis -sq tests/first_contact

.PHONY: test-desktop
test-desktop: set-up-test  ## the plugin in the real window of QGIS, by mouse and keyboard; pictures in build/desktop
	@$(PYTEST) -p no:pytest_qgis tests/desktop

.PHONY: test-session
test-session: set-up-test  ## 45 minutes of work in the real window of QGIS: three blocks, five algorithms, two projects
	@HRSI_SESSION_MINUTES=45 $(PYTEST) -p no:pytest_qgis -s tests/desktop/test_long_use.py

.PHONY: test-desktop-new
test-desktop-new:  ## the same with the QGIS, Python, NumPy and GDAL of Debian 13, made in build/trixie; needs root
	@scripts/test_on_new_debian.sh

.PHONY: qt6
qt6: set-up-test  ## the plugin's code and widgets on PyQt6, which goes to build/qt6 and nowhere else
	@[ -d $(BUILD)/qt6/PyQt6 ] || $(BIN)/python -m pip install --quiet --disable-pip-version-check --target $(BUILD)/qt6 -c constraints.txt PyQt6
	@PYTHONPATH=$(BUILD)/qt6 $(PYTEST) -p no:pytest_qgis -s tests/test_qt6.py

.PHONY: docs plugin wheel
docs: set-up-test  ## the documentation site, in build/docs; warnings are errors
	$(BIN)/python -m sphinx -q -W --keep-going -b html -d $(BUILD)/doctrees docs $(BUILD)/docs
	@echo "docs: $(BUILD)/docs/index.html"
plugin: set-up  ## the zip that QGIS installs, in dist; PUBLISHER="--email … --repository … --tracker …" to publish it
	$(BIN)/python scripts/make_plugin.py $(PUBLISHER)
wheel: set-up  ## the Python package, in dist
	@rm -rf $(BUILD)/lib $(BUILD)/bdist.*  # what an older version left would get into the wheel
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist .
	@ls dist/*.whl

.PHONY: screenshots
screenshots: set-up-test  ## the pictures of docs/pictures, made in QGIS on a virtual screen, and those of the plugin's help
	$(BIN)/python docs/make_screenshots.py
	$(BIN)/python docs/make_help_pictures.py

.PHONY: translations
translations: set-up-test  ## collect the plugin's texts into plugin/i18n/*.ts, and compile these (qttools5-dev-tools)
	@PATH=$$PATH:/usr/lib/qt5/bin $(QGIS_ENV) $(BIN)/python scripts/make_translations.py

.PHONY: fuzz
fuzz: set-up-test  ## the property-based tests with many more examples, and the readers guided by coverage; takes long
	$(PYTEST) -p no:pytest_qgis --ignore=tests/qgis --hypothesis-profile=fuzz -m fuzz tests
	$(BIN)/python tests/fuzz_readers.py --seconds 300

.PHONY: benchmarks
benchmarks: set-up-test  ## accuracy and speed figures
	@for script in benchmarks/*.py; do echo "== $$script"; $(BIN)/python $$script || exit; done

.PHONY: figures figures-check
figures: set-up-test  ## make the documentation's figures anew whose data or commands changed; takes long
	@$(BIN)/python benchmarks/figures.py renew
figures-check: set-up-test  ## a tenth of the figures' commands, another every day, compared with the documentation; ALL=1 all
	@$(BIN)/python benchmarks/figures.py check $(if $(ALL),,--turn)

.PHONY: structure
structure:  ## how the code is laid out, now and before: rooms, arrows, lines; written into docs/developing/structure.md
	@/usr/bin/python3 scripts/measure_structure.py --write

.PHONY: thresholds
thresholds: set-up-test  ## all thresholds by topic, with unit, meaning and origin; written into docs/developing/thresholds.md
	@$(BIN)/python scripts/list_thresholds.py

.PHONY: clean
clean:  ## remove the environment and everything made here
	rm -rf .venv $(BUILD) dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .qgis-settings
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

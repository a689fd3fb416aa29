# Every target makes what it needs: a virtual environment in .venv and the install in it.
# Only Python 3.11 or later and make have to be there.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: demo test notebooks check docs bench coverage torture fuzz clean help

help:
	@echo "make demo   show the whole product on a simulated test (writes demo-out/)"
	@echo "make test   run the tests"
	@echo "make notebooks  run the notebooks and compare with what is stored"
	@echo "make check  format, lint, types, import layers"
	@echo "make docs   build the site of the documents (build/docs/index.html); warnings are errors"
	@echo "make bench  speed, precision and memory of the measurement, beside rivals; 7 minutes"
	@echo "make coverage  do the stated uncertainties cover the errors; thousands of draws each"
	@echo "make torture  measure thousands of spoilt recordings, kill a batch hundreds of times"
	@echo "make fuzz   read tens of thousands of damaged files and setups"
	@echo "make clean  remove what these made"

demo: $(VENV)/installed
	$(BIN)/glint-aoa demo --out demo-out --overwrite

test: $(VENV)/installed-dev
	$(BIN)/python -m pytest -n auto --dist worksteal -q

notebooks: $(VENV)/installed-dev
	@rm -rf build/notebooks && mkdir -p build/notebooks && cp notebooks/*.ipynb build/notebooks
	$(BIN)/python -m pytest --nbmake --overwrite --nbmake-timeout=120 --rootdir=build/notebooks \
	  -c /dev/null -p no:cacheprovider -n auto -q build/notebooks
	$(BIN)/python notebooks/stored.py compare build/notebooks

check: $(VENV)/installed-dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(VENV)/installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -W error::DeprecationWarning -m mkdocs build --strict

bench: $(VENV)/installed-bench
	$(BIN)/python -m benchmarks

coverage: $(VENV)/installed-dev
	$(BIN)/python -m benchmarks.field_coverage
	$(BIN)/python -m benchmarks.mean_coverage
	$(BIN)/python -m benchmarks.inertial_coverage
	$(BIN)/python -m benchmarks.camera_coverage
	$(BIN)/python -m benchmarks.resection_coverage
	$(BIN)/python -m benchmarks.sweep_coverage
	$(BIN)/python -m benchmarks.budget_coverage
	$(BIN)/python -m benchmarks.twist_coverage
	$(BIN)/python -m benchmarks.plan_agreement
	$(BIN)/python -m benchmarks.fusion_coverage video no-video

torture: $(VENV)/installed-dev
	$(BIN)/python -m torture
	$(BIN)/python -m torture.kills
	$(BIN)/python -m torture.long
	$(BIN)/python -m benchmarks.live --long

fuzz: $(VENV)/installed-dev
	$(BIN)/python -m fuzz
	$(BIN)/python -m fuzz.setups

$(VENV)/created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or later is needed; name one with: make PYTHON=python3.12"; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	  { echo "This Python cannot make a virtual environment; install venv (on Debian: apt install python3-venv)"; exit 2; }
	@$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade "pip>=25.1"
	@touch $@

$(VENV)/installed: $(VENV)/created pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/installed-dev: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --group dev
	@touch $@

$(VENV)/installed-docs: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --group docs
	@touch $@

$(VENV)/installed-bench: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --group bench
	@# Without what they ask for: a second OpenCV in the same place, and nose
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps pyidi==1.4.0 pyMRAW==0.33.0
	@touch $@

clean:
	rm -rf $(VENV) demo-out build *.egg-info

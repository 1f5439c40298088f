# make demo | make test | make nightly | make lint | make docs | make tables | make faults | make fuzz | make soak | make benchmark | make benchmark-check | make benchmark-diagnosis | make clean. No environment variable is needed.
#
# On a sourced ROS 2 distribution that one is used (a virtual environment that sees the system's packages);
# on a bare machine ROS 2 comes as wheels from PyPI into .venv.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ROS := $(if $(AMENT_PREFIX_PATH),$(or $(ROS_DISTRO),distribution),wheels)

comma := ,
EXTRAS := $(if $(filter wheels,$(ROS)),test$(comma)ros$(comma)ament,test)
READY := $(VENV)/ready-$(ROS)

.PHONY: demo test nightly lint setup clean benchmark benchmark-check benchmark-diagnosis faults fuzz soak tables docs
.NOTPARALLEL:

demo: $(READY)
	@$(BIN)/python -m inductrack_ros.demo

test: $(READY) lint
	@$(BIN)/python -m pytest --numprocesses 3 --dist worksteal

# Whole diagnoses of the practice and blind campaigns, a minute or more each.
nightly: $(READY)
	@$(BIN)/python -m pytest --nightly -m nightly --numprocesses 2 --dist worksteal --durations=0

# docs/performance.md: against the peers of the extra `benchmark`, as far as they install, and a C compiler's loop.
benchmark: $(READY)
	-@$(BIN)/python -m pip install -qq --disable-pip-version-check --editable '.[benchmark]'
	@PYTHONPATH=benchmarks $(BIN)/python -m performance

benchmark-check: $(READY)
	@PYTHONPATH=benchmarks $(BIN)/python -m performance --check --output build/performance-check.json

benchmark-diagnosis: $(READY)
	@$(BIN)/python benchmarks/blind_diagnosis.py --output build/diagnosis.json

# What docs/robustness.md tells: the faults' figures, ten thousand wrong inputs and more (nightly), half an hour without loss.
faults: $(READY)
	@$(BIN)/python -m pytest -s test/test_faults_*.py test/test_nodes_record.py

fuzz: $(READY)
	@$(BIN)/python -m pytest test/test_fuzz.py test/test_fuzz_files.py --hypothesis-profile=nightly --durations=0

soak: $(READY)
	@$(BIN)/python benchmarks/soak.py

lint: $(READY)
	@$(BIN)/ruff check --quiet
	@$(BIN)/ruff format --quiet --check
	@$(BIN)/lint-imports --no-logo
	@$(BIN)/pyright --pythonpath $(BIN)/python

# The tables of docs/effects.md, docs/interfaces.md and docs/campaigns.md, from the code.
tables: $(READY)
	@$(BIN)/python docs/tables.py

# The pages and the API from docstrings: build/docs/index.html.
docs: $(READY)
	@$(BIN)/python -m pip install -qq --disable-pip-version-check --editable '.[docs]'
	@$(BIN)/python -m sphinx -q -W --keep-going -d build/doctrees docs build/docs

setup: $(READY)

$(READY): setup.py package.xml Makefile
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10) and "$(PYTHON) is Python %d.%d; 3.10 or newer is needed: make PYTHON=python3.12" % sys.version_info[:2])'
	@echo "Installing into $(VENV) (ROS 2: $(ROS)) ..."
	@ls $(READY) >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(if $(filter wheels,$(ROS)),,--system-site-packages) $(VENV)
	@$(BIN)/python -m pip install -qq --disable-pip-version-check --editable '.[$(EXTRAS)]'
	-@$(BIN)/python -c 'from inductrack_ros.core.model import Model; Model.default().kernel'  # compiled now, so that no first start waits
	@touch $@

clean:
	rm -rf $(VENV) build install log report docs/_api

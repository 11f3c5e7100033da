# Entry points: setup, demo, test, bench, proof, flash. Builds go to build/, Python to .venv.
SHELL := /bin/bash
# Hundreds of processes start in the tests; without compiled modules each takes two seconds longer.
unexport PYTHONDONTWRITEBYTECODE
VENV := .venv
PY := $(VENV)/bin/python
JOBS ?= $(shell nproc)
# Many tests wait for a board or a terminal.
TEST_WORKERS ?= $(shell expr $(JOBS) + 1)
SEED ?= 1
APT := cmake ninja-build ccache g++ pkg-config git gcc-avr avr-libc binutils-avr avrdude \
       libsimavr-dev libelf-dev libeigen3-dev libgtest-dev clang-tidy clang-format cppcheck \
       python3 python3-dev python3-venv chromium

.PHONY: help setup apt build demo test lint unit bench proof flash clean
help:
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/'

apt:
	@missing=$$(for p in $(APT); do \
	  dpkg-query -W -f='$${Status}' $$p 2>/dev/null | grep -q 'ok installed' || echo $$p; done); \
	if [ -n "$$missing" ]; then echo "apt-get install" $$missing; \
	  sudo=$$([ $$(id -u) = 0 ] || echo sudo); \
	  $$sudo apt-get update -qq && DEBIAN_FRONTEND=noninteractive $$sudo apt-get install \
	    -y -qq --no-install-recommends $$missing >/dev/null; fi

$(VENV)/bin/python:
	python3 -m venv $(VENV)
	$(PY) -m pip install -q --upgrade pip

# The package is installed again when a C, C++ or CMake source or the catalogue is newer than the
# last install, or when a Python module was added, moved or removed; an edited module needs no
# installation.
SOURCES := $(shell find firmware plant hil/bindings hil/replay hil/vgroove/gap/catalogue \
             -name '*.[ch]' -o -name '*.[ch]pp' -o -name CMakeLists.txt \
             -o -name '*.dbc' -o -name '*.py')
MODULES := build/python_modules.txt
$(shell mkdir -p build; find hil/vgroove -name '*.py' | sort > $(MODULES).new; \
        cmp -s $(MODULES).new $(MODULES) || cp $(MODULES).new $(MODULES))
$(VENV)/.installed: $(VENV)/bin/python pyproject.toml CMakeLists.txt hil/CMakeLists.txt \
                    $(SOURCES) $(MODULES)
	$(PY) -m pip install -q "scikit-build-core>=0.10" "nanobind>=2.4"
	$(PY) -m pip install -q --no-build-isolation -e ".[test]"
	@touch $@

setup: apt ## install what is missing through apt and pip
	@$(MAKE) --no-print-directory $(VENV)/.installed

define cmake_build
	@[ -f build/$(1)/build.ninja ] || cmake --preset $(1) > build/$(1).log 2>&1 || \
	  { cat build/$(1).log; exit 1; }
	@cmake --build --preset $(1) -j $(JOBS) $(if $(2),--target $(2)) -- --quiet
endef

build: setup ## build host, the AVR builds and the bindings
	$(call cmake_build,dev)
	$(call cmake_build,avr-uno)
	$(call cmake_build,avr-uno-drill)
	$(call cmake_build,avr-mega)
	$(call cmake_build,avr-uno-hil,vgroove)
	$(call cmake_build,avr-uno-drill-hil,vgroove)

demo: setup ## board and tool with a sealed effect, diagnosis: SEED=n TOOL=impact|drive
	$(call cmake_build,avr-uno,vgroove)
	$(call cmake_build,dev,vgroove-board vgroove_truth)
	@$(PY) tests/demo/demo.py --seed $(SEED) --tool $(or $(TOOL),impact)

lint: build
	$(VENV)/bin/ruff check .
	$(PY) -m pytest -q tests/lint

unit: build
	ctest --preset dev -j $(JOBS)

test: build ## everything that guards a change
	ctest --preset dev -j $(JOBS)
	$(VENV)/bin/ruff check .
	$(PY) -m pytest -n $(TEST_WORKERS) --dist loadgroup --no-loadscope-reorder --durations=20 tests

# The peers are installed apart from the package: those without a wheel are compiled, and need the
# build isolation that the package is installed without.
$(VENV)/.peers: pyproject.toml | setup
	@$(MAKE) --no-print-directory apt APT=gfortran
	@$(PY) -c 'import tomllib; f = open("pyproject.toml", "rb"); \
	  print(*tomllib.load(f)["project"]["optional-dependencies"]["bench"], sep="\n")' \
	  > build/peers.txt
	$(PY) -m pip install -q -r build/peers.txt
	@touch $@

bench: build $(VENV)/.peers ## comparisons with peers (installs those of the extra [bench])
	$(VENV)/bin/vgroove bench speed --json build/bench_speed.json
	$(VENV)/bin/vgroove bench trap --json build/bench_trap.json

proof: build ## checks that take longer; resumable, results into docs/results
	$(PY) -m pytest -n $(JOBS) --dist loadgroup --no-loadscope-reorder --proof tests
	$(PY) tests/proof/proof.py

flash: build ## make flash PORT=/dev/ttyUSB0 [TARGET=uno|mega] [TOOL=impact|drill]
	@test -n "$(PORT)" || { echo "name the port: make flash PORT=/dev/ttyUSB0"; exit 2; }
	$(PY) -m vgroove.cli flash $(PORT) --target $(or $(TARGET),uno) \
	  --tool $(or $(TOOL),impact)

clean:
	rm -rf build

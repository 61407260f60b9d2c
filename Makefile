# Needs python3 with venv, a C and C++ compiler, cmake and make; everything else is installed here.
# `make` alone lists the targets.

PYTHON ?= python3
VENV := .venv
COLCON_VENV := .venv-colcon
COLCON_BASE := build/colcon
BIN := $(VENV)/bin
INTERFACES := kane_dynamics_interfaces
DEMO_EXTRAS := ros demo
EXTRAS := $(DEMO_EXTRAS) test lint docs

# The environments stand alone: nothing of a sourced ROS, or of another environment with ROS
# wheels (whose start-up hook hides its library path behind a variable that children inherit), may
# reach them.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH \
  LD_LIBRARY_PATH PYTHONPATH PYTHONHOME ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION \
  RMW_IMPLEMENTATION VIRTUAL_ENV

# Bytecode is kept, whatever the caller's environment says: tests start hundreds of interpreters.
unexport PYTHONDONTWRITEBYTECODE
export PYTHONPYCACHEPREFIX := $(CURDIR)/build/bytecode

# What runs here stays on this machine and away from every robot, whatever the caller's domain.
ROS_ISOLATION = ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID=$$((1 + $$$$ % 100))
ROS_ENV = AMENT_PREFIX_PATH='$(CURDIR)/$(VENV)' $(ROS_ISOLATION)

INTERFACE_SOURCES := $(wildcard $(addprefix $(INTERFACES)/,msg/*.msg srv/*.srv action/*.action \
  CMakeLists.txt package.xml pip_ros.cmake pyproject.toml))
PROJECT_SOURCES := $(shell find kane_dynamics config launch urdf -name __pycache__ -prune \
  -o -type f -print 2>/dev/null | LC_ALL=C sort)
METADATA := package.xml setup.py setup.cfg MANIFEST.in pyproject.toml README.md

.PHONY: help install demo test install-test test-slow soak mutants bench kernel-sizes llvm-texts picture lint docs docs-test colcon-test clean FORCE

help:
	@echo 'make install      environment $(VENV) with the library, the node and all tools'
	@echo 'make demo         feedforward on a simulated arm, over ROS 2;'
	@echo 'make test         tests, a quarter of an hour: library, torque path, services'
	@echo 'make install-test ways of installation: slim, wheel, source, oldest and newest releases'
	@echo 'make test-slow    tests of endurance (also: make soak)'
	@echo 'make mutants      small defects in changed files, each against its nearest tests'
	@echo 'make bench        speed, against peers; a report in build/bench'
	@echo 'make kernel-sizes records the arithmetic and code size of the shipped kernels'
	@echo 'make llvm-texts   the C sources of the package as LLVM text, by clang 15'
	@echo 'make picture      docs/view.png, by a headless Chromium, and docs/demo.webp, by OSMesa'
	@echo 'make lint         ruff, mypy --strict, ament_flake8, ament_pep257'
	@echo 'make docs         the documentation site, in build/docs'
	@echo 'make docs-test    tries what the pages of the site and the README show'
	@echo 'make colcon-test  both packages built by colcon, and all tests of the node, in $(COLCON_VENV)'
	@echo 'make clean        remove all of that'

# ---------------------------------------------------------------------- environment

install: $(VENV)/.dependencies $(VENV)/.interfaces $(VENV)/.project

# A pip of the system, if there is one, saves the seconds that a pip of our own takes.
PIP_UV := install --quiet --disable-pip-version-check uv
$(VENV)/.uv:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and \
	  "python3 is %d.%d, but 3.11 or newer is needed: make PYTHON=..." % sys.version_info[:2])'
	$(PYTHON) -m venv --without-pip $(VENV)
	@$(PYTHON) -m pip --python $(BIN)/python $(PIP_UV) 2> /dev/null \
	  || { $(BIN)/python -m ensurepip > /dev/null && $(BIN)/python -m pip $(PIP_UV); }
	@touch $@

# The dependencies alone, so that a changed source later installs only the project; those of the
# demo before all others, so that it starts sooner.
$(VENV)/.demo_dependencies: $(VENV)/.uv setup.py
	$(BIN)/uv pip install --python $(BIN)/python --quiet -r setup.py $(DEMO_EXTRAS:%=--extra %)
	@touch $@

$(VENV)/.dependencies: $(VENV)/.demo_dependencies setup.py
	$(BIN)/uv pip install --python $(BIN)/python --quiet -r setup.py $(EXTRAS:%=--extra %)
	@touch $@

# The first import compiles bytecode for seconds, and looks at all fonts: done while the interfaces
# are built.
$(VENV)/.imported: $(VENV)/.demo_dependencies
	@AMENT_PREFIX_PATH='$(CURDIR)/$(VENV)' nice -n 19 $(BIN)/python -c 'import llvmlite.binding, \
	  matplotlib.pyplot, mujoco, rclpy.lifecycle, sensor_msgs.msg, yourdfpy'
	@touch $@

# PyTorch is tested where its build for the CPU can be had; the builds of the package index bring
# gigabytes of CUDA, which no test needs. The label +cpu matches none of them.
TORCH := torch==2.13.0+cpu
$(VENV)/.torch: $(VENV)/.dependencies
	@if test -n '$(PIP_FIND_LINKS)' && $(BIN)/uv pip install --python $(BIN)/python --quiet \
	  $(PIP_FIND_LINKS:%=--find-links '%') '$(TORCH)'; then touch $@; \
	else echo '$(TORCH) is not where PIP_FIND_LINKS points: tests of PyTorch are skipped'; fi

# Built in an environment of its own, while the dependencies are installed if make runs parallel.
$(VENV)/.interfaces_wheel: $(INTERFACE_SOURCES) | $(VENV)/.uv
	@echo 'building $(INTERFACES) (about a minute)'
	@rm -rf build/wheel
	$(BIN)/uv build --python $(BIN)/python --quiet --wheel --out-dir build/wheel ./$(INTERFACES)
	@touch $@

$(VENV)/.interfaces: $(VENV)/.interfaces_wheel | $(VENV)/.demo_dependencies
	$(BIN)/uv pip install --python $(BIN)/python --quiet --no-deps --reinstall build/wheel/*.whl
	@touch $@

# The names of the sources: a deleted file is a change too, though no file is newer for it.
$(VENV)/.files: $(VENV)/.uv FORCE
	@echo '$(PROJECT_SOURCES)' | cmp -s - $@ || echo '$(PROJECT_SOURCES)' > $@

# Not editable: that would leave out the ament marker and share/. The old build/lib may hold modules
# that have been deleted since.
$(VENV)/.project: $(VENV)/.demo_dependencies $(VENV)/.files $(METADATA) $(PROJECT_SOURCES)
	@rm -rf build/lib build/bdist.*
	$(BIN)/uv pip install --python $(BIN)/python --quiet --no-deps --reinstall .
	@touch $@

# ---------------------------------------------------------------------- use and tests

# Installs only what the demo needs, on two processors.
demo:
	@$(MAKE) --no-print-directory $(if $(filter -j%,$(MAKEFLAGS)),,-j2) $(VENV)/.interfaces \
	  $(VENV)/.project $(VENV)/.imported
	$(ROS_ENV) $(BIN)/python -m kane_dynamics.demo

# What runs nodes in real time has the processors to itself; all else shares them. Faults, starts, whole graphs, plant_node, rarer arms and modes, and long commands are minutes of
# waiting: colcon-test alone tries them.
REAL_TIME = $(wildcard test/e2e/test_node*.py) test/e2e/test_demo.py
BY_COLCON = $(addprefix test/e2e/test_,demo.py node_activation.py node_arm_compensates.py \
  node_beside_moveit.py node_closed_loops.py node_constraints.py \
  node_contact.py node_doctor.py \
  node_false_states.py node_faults.py node_feedforward.py node_filled_closed_loops.py \
  node_flexible.py node_flexible_loops.py node_guard.py node_guard_failures.py node_guard_payload.py \
  node_in_a_system.py node_independent.py node_joint_trajectory_action.py node_lifecycle.py \
  node_loads.py node_loads_at_start.py \
  node_monitor.py node_native_path.py node_plant.py node_predictive_control.py \
  node_redundant_actuators.py node_second_guard.py node_sim_time.py node_task_modes.py \
  node_two_arms.py)
LONG_COMMANDS = $(addprefix test/e2e/test_cli_,beams.py constraints.py feasible.py identify.py \
  replay.py sweep.py view.py)

# Slow tests that alone check a promise; all others run by `make test-slow`, each night.
ONLY_CHECKS = 'test/property/test_feature_matrix.py::test_every_feature_is_right_or_refused_for[elastic joints]' \
  test/peer/test_two_mass_arm.py test/unit/ros/test_ros_task_modes_of_loops.py \
  $(addprefix test/unit/simulation/test_,elastic_joints_in_motion.py stability.py) \
  $(addprefix test/unit/task_space/test_,hand_guiding.py hybrid_force.py joint_impedance.py \
  operational_space.py orientation_error.py pose_filter.py)

# A machine that stalls fails a test of a node, whose time-outs are real, whatever the code does; a
# defect fails it twice.
PYTEST = $(ROS_ENV) $(BIN)/python -m pytest
REPEATED = echo '== what failed is repeated once, by itself';
FAILED_ONES = --last-failed --last-failed-no-failures=none
LIBRARY = $(patsubst %,--ignore=%,$(REAL_TIME) $(LONG_COMMANDS)) --ignore=test/docs --ignore=test/installation $(PYTEST_ARGS)
ALONE = $(filter-out $(BY_COLCON), $(REAL_TIME)) $(PYTEST_ARGS)

test: install $(VENV)/.torch
	$(PYTEST) -n auto --dist worksteal $(LIBRARY) || { $(REPEATED) $(PYTEST) $(FAILED_ONES) $(LIBRARY); }
	$(PYTEST) -n auto --dist worksteal -m slow $(ONLY_CHECKS)
	$(PYTEST) $(ALONE) || { $(REPEATED) $(PYTEST) $(FAILED_ONES) $(ALONE); }

# Into environments of their own, from the package index.
install-test: install
	$(PYTEST) -s test/installation

test-slow soak: install
	$(ROS_ENV) $(BIN)/python -m pytest -m slow --timeout 3600 $(PYTEST_ARGS)
	$(ROS_ENV) HYPOTHESIS_PROFILE=thorough $(BIN)/python -m pytest -n auto --dist worksteal \
	  --timeout 3600 test/property $(PYTEST_ARGS)

# MUTANTS='--since main~20 --seed 3': other files, other mutants.
mutants: install
	$(ROS_ENV) $(BIN)/python tools/mutants.py $(MUTANTS)

$(VENV)/.bench: $(VENV)/.dependencies
	$(BIN)/uv pip install --python $(BIN)/python --quiet -r setup.py --extra bench
	@touch $@

# crocoddyl's wheels are built for this Pinocchio: beside a newer one they compute without gravity.
CROCODDYL_VENV := .venv-crocoddyl
$(CROCODDYL_VENV)/.tools: $(VENV)/.uv
	@$(PYTHON) -m venv $(CROCODDYL_VENV)
	@if $(BIN)/uv pip install --python $(CROCODDYL_VENV)/bin/python --quiet crocoddyl==3.2.1 \
	  pin==4.0.0; then touch $@; \
	else rm -rf $(CROCODDYL_VENV); echo 'crocoddyl cannot be installed: its gate is not checked'; fi

# All of them run, then any failure counts.
BENCHMARKS ?= benchmarks/report.py benchmarks/exported_c.py benchmarks/torque_path.py \
  benchmarks/learning_functions.py benchmarks/time_optimal.py \
  benchmarks/first_uses.py benchmarks/method_overheads.py \
  benchmarks/predictive_control.py benchmarks/task_space_laws.py benchmarks/task_space_calls.py \
  benchmarks/node_latency.py,palletizer benchmarks/node_latency.py \
  benchmarks/node_latency.py,native,palletizer benchmarks/node_latency.py,native \
  benchmarks/state_rates.py benchmarks/state_rates.py,native
BENCH_ARGS ?=

# A program's own arguments follow it after commas.
bench: install $(VENV)/.bench $(VENV)/.torch $(CROCODDYL_VENV)/.tools
	@failed=; for program in $(BENCHMARKS); do \
	  echo "== $$program"; \
	  $(ROS_ENV) $(BIN)/python $$(echo $$program | tr , ' ') $(BENCH_ARGS) \
	    || failed="$$failed $$program"; \
	done; test -z "$$failed" || { echo "failed:$$failed"; exit 1; }

picture: install
	PYTHONPATH='$(CURDIR):$(CURDIR)/test/helpers' $(BIN)/python docs/view.py docs/view.png
	MUJOCO_GL=$${MUJOCO_GL:-osmesa} AMENT_PREFIX_PATH='$(CURDIR)/$(VENV)' PYTHONPATH='$(CURDIR)' \
	  $(BIN)/python docs/moving_demo.py docs/demo.webp

kernel-sizes: install
	PYTHONPATH='$(CURDIR)' $(BIN)/python benchmarks/kernel_sizes.py

# C sources of the package as LLVM text without what names a processor: the package has it, so that
# nobody else needs this compiler.
C_SOURCES := kane_dynamics/native/runtime/loops.c kane_dynamics/native/runtime/message_loop.c kane_dynamics/native/python_call/entry.c
LLVM_TEXTS ?= .
llvm-texts:
	for source in $(C_SOURCES:.c=); do made=$(LLVM_TEXTS)/$$source.ll; mkdir -p $$(dirname $$made); \
	  clang-15 -std=c11 -O2 -ffp-contract=off -fno-strict-aliasing -fno-vectorize -fno-slp-vectorize \
	    -fno-unroll-loops -fno-asynchronous-unwind-tables -fno-stack-protector -fno-pic -fno-ident \
	    -S -emit-llvm -o $$made $$source.c && \
	  sed -i -E -e '/^(; ModuleID|source_filename|target )/d' -e '/^declare/s/ allocptr//' -e '/^attributes/s/ ("[^"]*"="[^"]*"|alloc[a-z]*\([^)]*\))//g' \
	    -e 's/^(attributes .* = \{) +\}/\1 nounwind }/' $$made \
	  || exit 1; done

LINTED = $(wildcard kane_dynamics test examples benchmarks docs launch tools setup.py $(INTERFACES)/test)

lint: install
	$(BIN)/ruff check $(LINTED)
	$(BIN)/mypy
	$(BIN)/ament_flake8 $(LINTED)
	$(BIN)/ament_pep257 $(LINTED)

# Warnings are errors; nothing is fetched.
docs: install
	rm -rf build/docs
	$(ROS_ENV) $(BIN)/python -m sphinx -b html -W -n --keep-going -q -j auto -d build/doctrees docs build/docs
	$(BIN)/python docs/check_links.py build/docs

# What the pages show is what comes out.
NODE_PAGES = test/docs/test_node_pages.py

docs-test: install $(VENV)/.torch
	$(PYTEST) -n auto --dist worksteal test/docs --ignore=$(NODE_PAGES)
	$(PYTEST) $(NODE_PAGES) || { $(REPEATED) $(PYTEST) $(FAILED_ONES) $(NODE_PAGES); }

# ---------------------------------------------------------------------- colcon
# An environment of its own: colcon wants an older setuptools, and both packages must come from its
# install folder.
$(COLCON_VENV)/.tools: $(VENV)/.uv setup.py $(INTERFACES)/pyproject.toml
	$(PYTHON) -m venv $(COLCON_VENV)
	$(BIN)/python -c 'import tomllib; print(*tomllib.load(open("$(INTERFACES)/pyproject.toml", \
	  "rb"))["build-system"]["requires"], sep="\n")' > $(COLCON_VENV)/interfaces.txt
	$(BIN)/uv pip install --python $(COLCON_VENV)/bin/python --quiet \
	  'setuptools<80' colcon-common-extensions -r $(COLCON_VENV)/interfaces.txt \
	  -r setup.py --extra ros --extra test
	@touch $@

COLCON_ENV = VIRTUAL_ENV='$(CURDIR)/$(COLCON_VENV)' PATH="$(CURDIR)/$(COLCON_VENV)/bin:$$PATH" \
  AMENT_PREFIX_PATH='$(CURDIR)/$(COLCON_VENV)' CMAKE_PREFIX_PATH='$(CURDIR)/$(COLCON_VENV)' \
  $(ROS_ISOLATION) \
  COLCON_DEFAULTS_FILE='$(CURDIR)/colcon_defaults.yaml' COLCON_LOG_PATH=$(COLCON_BASE)/log
COLCON_FOLDERS = --build-base $(COLCON_BASE)/build --install-base $(COLCON_BASE)/install
# How fast the node is does not depend on who installed it.
COLCON_TESTS ?= test/unit/_util/test_resources.py test/unit/ros/test_launch.py \
  $(filter-out test/e2e/test_node_load.py, $(wildcard test/e2e/test_*.py))

COLCON_TEST = $(COLCON_ENV) colcon test $(COLCON_FOLDERS) --event-handlers console_direct+ \
  --return-code-on-test-failure --pytest-args $(COLCON_TESTS)

# Tests of the node once more, with the interpreter's torque path.
INTERPRETER_TEST = KANE_DYNAMICS_TEST_TORQUE_PATH=python $(COLCON_ENV) colcon test $(COLCON_FOLDERS) \
  --packages-select kane_dynamics --event-handlers console_direct+ --return-code-on-test-failure \
  --pytest-args $(addprefix test/e2e/test_node_,torques.py faults.py false_states.py)

# The Python package is built anew, since colcon leaves deleted modules where they were. The results
# are looked for by name: a package without any would pass.
colcon-test: $(COLCON_VENV)/.tools
	rm -rf $(COLCON_BASE)/*/kane_dynamics $(COLCON_BASE)/build/*/test_results
	$(COLCON_ENV) colcon build $(COLCON_FOLDERS) --event-handlers console_cohesion+ \
	  --cmake-args -DBUILD_TESTING=ON -DCMAKE_PROJECT_INCLUDE='$(CURDIR)/$(INTERFACES)/pip_ros.cmake'
	$(COLCON_TEST) || { $(REPEATED) $(COLCON_TEST) $(FAILED_ONES:%=' %'); }
	$(INTERPRETER_TEST) || { $(REPEATED) $(INTERPRETER_TEST) $(FAILED_ONES:%=' %'); }
	$(COLCON_ENV) colcon test-result --test-result-base $(COLCON_BASE)/build --all
	@grep -q '<testcase' $(COLCON_BASE)/build/kane_dynamics/pytest.xml
	@grep -q '<testcase' $(COLCON_BASE)/build/$(INTERFACES)/test_results/$(INTERFACES)/*.xml

clean:
	rm -rf $(VENV) $(COLCON_VENV) $(CROCODDYL_VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache

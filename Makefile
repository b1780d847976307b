# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0
#
# The commands of the project. Each first sets up what is missing (.venv, build/, install/).
#
#   PYTHON=python3.12   interpreter to set up with (default: the first that fits)
#   ARGS='...'          passed on by bench, board, bridge, button, console, ctl, demo,
#                       inspect-kart, record, rehearsal, sim, soak, spare, survey, takeover, test,
#                       test-alone, test-long, timekeeper and timing
#   WORKERS=8           number of tests that run at the same time; most tests mostly wait
WORKERS := 8

IN_WORKSPACE := setup/in-workspace

# The tests run make themselves; these variables must not reach it.
unexport ARGS MAKEFLAGS MFLAGS WORKERS

# The files for `make run` (and the roster for `make roster`), relative to where make was called.
# PARAMS: race control's parameters; TIMING: the timekeeper's.
ROSTER := src/evgp_rcs/config/karts.yaml
PARAMS := src/evgp_rcs/config/rcs.yaml
TIMING := src/evgp_timing/config/timekeeper.yaml

# This machine's own address on the officials' network; empty: officials use this machine only, and
# our programs stay on it, whatever ROS is configured to do (docs/security.md).
OFFICIALS := $(EVGP_GRAPH_INTERFACE)
board button timing: export EVGP_GRAPH_INTERFACE := $(OFFICIALS)

# This machine's own address on the karts' network; empty: the one in PARAMS. With OFFICIALS, race
# control needs it, so that karts never reach the officials' network.
ADDRESS :=

# For a spare machine (docs/operations.md): race control's machine, its record if that is not in the
# usual place, and the interface here that takes over ADDRESS.
FROM :=
RECORD :=
INTERFACE :=

# The official at the window or ctl; empty: the saved name, or else the program asks.
OFFICIAL ?=

# A word of a command, whatever is in it; and a parameter, since ROS reads values as YAML.
quoted = '$(subst ','\'',$(1))'
parameter = -p $(call quoted,$(1):='$(subst ','',$(2))')

# A test must not command a real kart: neither our programs, nor nodes with ROS's own settings.
bench demo screenshots sim soak test test-alone test-long: export EVGP_GRAPH_INTERFACE :=
bench demo screenshots sim soak test test-alone test-long: export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

# The kart's bridge: race control's address, and the topic of the kart's odometry, which the bridge
# then requires. ARGS holds what follows --ros-args, such as '-p auto_acknowledge_stop:=true'.
HOST :=
ODOM :=

# This machine's address for the board's viewers; empty: this machine only.
AT :=

# A timing device's kind and address (docs/timing.md), or a stop button (docs/button.md).
KIND :=
DEVICE :=

.PHONY: help setup deb demo sim rehearsal test test-alone test-long bench soak run roster record console ctl board button bridge timing \
  timekeeper spare takeover inspect-kart survey screenshots kit-size lines lint format clean

# Officials and teams see what the programs print, and not the recipes.
.SILENT: board bridge button console ctl record rehearsal roster run spare takeover timekeeper timing

help:
	@echo 'make demo    set up, run two races automatically without a window, and check what happened'
	@echo 'make sim     race three kinds of karts in a simulator, and draw an animation  (ARGS="--laps 3")'
	@echo 'make rehearsal  train officials: simulated karts, incidents, debrief  (ARGS="--karts 6")'
	@echo 'make test    set up and run all tests except the long ones (ARGS="-k roster")'
	@echo 'make test-long  set up and run the long tests       (ARGS="-k roster")'
	@echo 'make test-alone  run the long tests that need every processor for themselves'
	@echo 'make soak    test race control under random faults and commands (ARGS="--seconds 60")'
	@echo 'make bench   measure how fast a stop reaches karts  (ARGS="--karts 20")'
	@echo 'make run     start race control and the timekeeper for a real event   (ROSTER=karts.yaml PARAMS=rcs.yaml OFFICIALS=10.1.0.5 ADDRESS=10.0.0.1)'
	@echo 'make roster  check a roster without starting anything (ROSTER=karts.yaml)'
	@echo 'make spare   keep a copy of race control            (FROM=anna@10.1.0.5:evgp ROSTER=karts.yaml PARAMS=rcs.yaml)'
	@echo 'make takeover  take over from a dead race control    (ADDRESS=10.0.0.1 INTERFACE=eth0 OFFICIALS=10.1.0.6)'
	@echo 'make timing  read a timing device at the line       (KIND=p3 DEVICE=10.1.0.20:5403 OFFICIALS=10.1.0.7)'
	@echo 'make board   show the race to spectators and pit walls on web pages  (AT=10.2.0.5 OFFICIALS=10.1.0.7)'
	@echo 'make record  print what happened in the last run     (ARGS="--list", ARGS="--help")'
	@echo "make bridge  start the bridge on a kart               (HOST=10.0.0.1 ODOM=/odom ARGS='-p ...')"
	@echo "make inspect-kart  check whether a kart is fit to race; needs no set-up  (ARGS='--number 7')"
	@echo 'make survey  check the WLAN on the whole track; needs no set-up'
	@echo "make console open the officials' window               (OFFICIAL=Anna OFFICIALS=10.1.0.6)"
	@echo "make timekeeper  open the timekeeper's window         (OFFICIAL=Tina OFFICIALS=10.1.0.6)"
	@echo 'make ctl     command and watch the race in a terminal  (ARGS="watch" OFFICIALS=10.1.0.6)'
	@echo 'make button  use a button to send ALL KILL; without DEVICE, list the devices (DEVICE=/dev/input/by-id/...)'
	@echo 'make kit-size  show the size of the C code for karts on a Cortex-M0'
	@echo 'make lines   count the lines of product, tests and tools, and documents'
	@echo 'make lint    check style and types'
	@echo 'make format  format the code'
	@echo 'make screenshots  retake the pictures in docs/'
	@echo 'make setup   only set up, including what the window needs'
	@echo 'make deb     build the Debian package for officials'
	@echo 'make clean   remove everything the set-up created'

setup:
	$(IN_WORKSPACE) --console true

# docs/install-officials.md; not a VERSION of the environment, which may be any program's.
VERSION :=
deb:
	$(IN_WORKSPACE) --console python setup/deb.py $(VERSION)

demo:
	$(IN_WORKSPACE) install/evgp_rehearsal/lib/evgp_rehearsal/demo $(ARGS)

# ARGS="--stack 'ros2 run my_kart stack'"; kit/sim/README.md
sim:
	$(IN_WORKSPACE) python kit/sim/race.py $(ARGS)

PYTEST = $(IN_WORKSPACE) --console python -m pytest

test:
	$(PYTEST) -n $(WORKERS) --dist worksteal -m 'not long' $(ARGS)

# docs/dev/testing.md says which tests are long, and why. Each free worker takes the next test.
# Searches use a whole core; with more of them at once, race control and karts could not keep time.
test-long:
	$(PYTEST) -n 4 --maxschedchunk 1 -m 'long and not alone' $(ARGS)

test-alone:
	$(PYTEST) -m alone $(ARGS)

soak:
	$(IN_WORKSPACE) python soak/run.py $(ARGS)

bench:
	$(IN_WORKSPACE) python bench/performance.py $(ARGS)

# setup/official says what each takes, and what it runs.
SETTINGS := ADDRESS FROM INTERFACE OFFICIAL OFFICIALS PARAMS RECORD ROSTER TIMING
console ctl record rehearsal roster run spare takeover timekeeper:
	$(IN_WORKSPACE) $(if $(filter console rehearsal timekeeper,$@),--console) setup/official \
	  $(@:console=window) $(foreach each,$(SETTINGS),$(call quoted,$(each)=$($(each)))) \
	  $(or $(ARGS),$(ARG))

# It restarts after a crash, but not if a setting is wrong.
RCS_BUTTON := install/evgp_rcs_console/lib/evgp_rcs_console/rcs_button
button:
	$(IN_WORKSPACE) $(if $(DEVICE),python -m evgp_node.restarting $(RCS_BUTTON) --ros-args \
	  $(call parameter,device,$(DEVICE)) \
	  $(if $(OFFICIAL),$(call parameter,official,$(OFFICIAL))) $(ARGS),$(RCS_BUTTON) test $(ARGS))

# It restarts in RED_RED after a failure or a crash, but not if a setting is wrong.
bridge:
	if [ -z '$(HOST)' ]; then echo 'Give the address of race control: make bridge HOST=10.0.0.1' >&2; exit 2; fi
	$(IN_WORKSPACE) python -m evgp_node.restarting \
	  install/evgp_kart_bridge/lib/evgp_kart_bridge/kart_bridge_node --ros-args \
	  $(call parameter,host,$(HOST)) \
	  $(if $(ODOM),-r '~/odom:=$(ODOM)' -p odometry_required:=true) $(ARGS)

# It restarts after a crash, but not if a setting is wrong.
timing:
	$(IN_WORKSPACE) python -m evgp_node.restarting \
	  install/evgp_timing/lib/evgp_timing/timing_source --ros-args \
	  $(if $(KIND),$(call parameter,kind,$(KIND))) \
	  $(if $(DEVICE),$(call parameter,device,$(DEVICE))) $(ARGS)

# It restarts after a crash, but not if a setting is wrong.
board:
	$(IN_WORKSPACE) python -m evgp_node.restarting \
	  install/evgp_board/lib/evgp_board/board --ros-args $(if $(AT),$(call parameter,address,$(AT))) $(ARGS)

# Needs only Python, because the inspector's computer may have nothing set up.
inspect-kart:
	python3 src/evgp_inspection kart $(ARGS)

# Also needs only Python; run it on race control's computer the day before.
survey:
	python3 src/evgp_inspection survey $(ARGS)

# The pictures in docs/, made by the tests that look at every state of the window.
screenshots:
	EVGP_ALL_TESTS=1 EVGP_SCREENSHOTS=docs/screenshots $(IN_WORKSPACE) --console \
	  python -m pytest src/evgp_rcs_console/test/test_window.py test/test_board.py \
	  test/test_report_page.py -k screenshots

# Sizes without the C library; text is flash, bss is memory.
kit-size:
	@object=$$(mktemp); trap "rm $$object" EXIT; for header in KART BOARD; do \
	  arm-none-eabi-gcc -mcpu=cortex-m0 -mthumb -std=c99 -Os -Ikit/c -DEVGP_$$header \
	    -c kit/c/test/size.c -o $$object && arm-none-eabi-size $$object || exit; done

lines:
	@python3 setup/lines.py

# Every check runs, even if an earlier one failed.
lint:
	@failed=; \
	for check in 'ruff check' 'ruff format --check' 'setup/without-ros flake8' \
	    'pydocstyle bench kit setup soak src test' mypy; do \
	  echo "$$check"; \
	  $(IN_WORKSPACE) $$check || failed=1; \
	done; \
	test -z "$$failed"

format:
	$(IN_WORKSPACE) ruff check --fix
	$(IN_WORKSPACE) ruff format

clean:
	rm -rf .venv build install log

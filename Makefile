# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0
#
# The commands of the project. Each sets up first what is not set up yet (.venv, build/, install/).
#
#   PYTHON=python3.12   the interpreter to set up with, otherwise the first that fits
#   ARGS='...'          passed on by bench, board, bridge, button, console, ctl, demo, fuzz,
#                       inspect-kart, record, rehearsal, soak, survey, test, test-long,
#                       timekeeper and timing
#   WORKERS=8           number of tests that run at the same time; most of the time, most of them wait
WORKERS := 8

IN_WORKSPACE := setup/in-workspace

# What this make was told is not for the makes that its tests run.
unexport ARGS MAKEFLAGS MFLAGS WORKERS

# What `make run` starts race control and the timekeeper with, and `make roster` checks; relative to
# where make was called. PARAMS are those of race control, TIMING those of the timekeeper.
ROSTER := src/evgp_rcs/config/karts.yaml
PARAMS := src/evgp_rcs/config/rcs.yaml
TIMING := src/evgp_timing/config/timekeeper.yaml

# This machine's own address on the officials' network; empty: the officials are at this machine
# only. Our programs stay on the machine otherwise, whatever ROS is told: docs/security.md.
OFFICIALS := $(EVGP_GRAPH_INTERFACE)
run board button console ctl takeover timekeeper timing: export EVGP_GRAPH_INTERFACE := $(OFFICIALS)

# This machine's own address on the karts' network; empty: what PARAMS says. With OFFICIALS, race
# control must know it, so that karts never reach the officials' network.
ADDRESS :=

# For a spare machine (docs/operations.md): where race control's machine is, where it has its record
# if not in the usual place, and the interface here that takes ADDRESS over.
FROM :=
RECORD :=
INTERFACE :=

# Who commands from the window or by ctl; empty: the name that is kept, or else asked for.
OFFICIAL ?=
OFFICIAL_QUOTED = $(subst ','\'',$(OFFICIAL))

# A test must not command a real kart: neither our programs, nor nodes with ROS's own settings.
bench demo fuzz rehearsal screenshots soak test test-long: export EVGP_GRAPH_INTERFACE :=
bench demo fuzz rehearsal screenshots soak test test-long: export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

# The kart's bridge: race control's address, the topic of the kart's odometry (when it is given,
# the bridge requires odometry), and what follows --ros-args in ARGS, such as
# '-p auto_acknowledge_stop:=true'.
HOST :=
ODOM :=

# This machine's own address at which viewers reach the board; empty: this machine only.
AT :=

# A timing device: its kind, and where it is (docs/timing.md). Or a stop button (docs/button.md).
KIND :=
DEVICE :=

.PHONY: help setup deb demo sim rehearsal test test-long bench soak fuzz run roster record console ctl board button bridge timing \
  timekeeper spare takeover inspect-kart survey screenshots kit-size lines lint format clean

help:
	@echo 'make demo    set up and run two races by themselves, without a window; checks what happened'
	@echo 'make sim     three karts of three kinds race in a simulator; a moving picture of it  (ARGS="--laps 3")'
	@echo 'make rehearsal  train officials: simulated karts, incidents, debrief  (ARGS="--karts 6")'
	@echo 'make test    set up and run every test but the long (ARGS="-k roster")'
	@echo 'make test-long  set up and run the long tests       (ARGS="-k roster")'
	@echo 'make soak    race control under random faults and commands (ARGS="--seconds 60")'
	@echo 'make bench   measure how soon a stop reaches karts  (ARGS="--karts 20")'
	@echo 'make fuzz    fuzz the decoders and the roster loader, guided by coverage'
	@echo 'make run     start race control and the timekeeper for a real event   (ROSTER=karts.yaml PARAMS=rcs.yaml OFFICIALS=10.1.0.5 ADDRESS=10.0.0.1)'
	@echo 'make roster  check a list of karts, without starting anything (ROSTER=karts.yaml)'
	@echo 'make spare   keep a copy of race control            (FROM=anna@10.1.0.5:evgp ROSTER=karts.yaml PARAMS=rcs.yaml)'
	@echo 'make takeover  take over from a dead race control    (ADDRESS=10.0.0.1 INTERFACE=eth0 OFFICIALS=10.1.0.6)'
	@echo 'make timing  read a timing device at the line         (KIND=p3 DEVICE=10.1.0.20:5403 OFFICIALS=10.1.0.7)'
	@echo 'make board   show the race to spectators and pit walls, on web pages  (AT=10.2.0.5 OFFICIALS=10.1.0.7)'
	@echo 'make record  print what happened in the last run     (ARGS="--list", ARGS="--help")'
	@echo "make bridge  on a kart: start its bridge              (HOST=10.0.0.1 ODOM=/odom ARGS='-p ...')"
	@echo "make inspect-kart  is this kart fit to race? Needs no set-up  (ARGS='--number 7')"
	@echo 'make survey  is the WLAN good on the whole track? Needs no set-up'
	@echo "make console open the officials' window               (OFFICIAL=Anna OFFICIALS=10.1.0.6)"
	@echo "make timekeeper  open the timekeeper's window         (OFFICIAL=Tina OFFICIALS=10.1.0.6)"
	@echo 'make ctl     command and watch in the terminal       (ARGS="watch" OFFICIALS=10.1.0.6)'
	@echo 'make button  a button that sends ALL KILL; without DEVICE it shows what there is (DEVICE=/dev/input/by-id/...)'
	@echo 'make kit-size  what the C code for karts takes of a Cortex-M0'
	@echo 'make lines   count the lines of the product, of tests and tools, and of the documents'
	@echo 'make lint    check style and types'
	@echo 'make format  format the code'
	@echo 'make screenshots  take the pictures of docs/ again'
	@echo 'make setup   set up only, with what the window needs'
	@echo 'make deb     build the Debian package for officials'
	@echo 'make clean   remove all that the set-up made'

setup:
	$(IN_WORKSPACE) --console true

# docs/install-officials.md
deb:
	$(IN_WORKSPACE) --console python setup/deb.py $(VERSION)

demo:
	$(IN_WORKSPACE) install/evgp_rehearsal/lib/evgp_rehearsal/demo $(ARGS)

# ARGS="--stack 'ros2 run my_kart stack'"; kit/sim/README.md
sim:
	$(IN_WORKSPACE) python kit/sim/race.py $(ARGS)

# Loopback only, and a ROS domain of its own: it cannot reach a real kart.
rehearsal:
	$(IN_WORKSPACE) --console install/evgp_rehearsal/lib/evgp_rehearsal/rehearse $(ARGS)

PYTEST = $(IN_WORKSPACE) --console python -m pytest

test:
	$(PYTEST) -n $(WORKERS) --dist worksteal -m 'not long' $(ARGS)

# What takes long, and why, stands in docs/dev/testing.md. Each worker takes the next when it is free.
# Searches use all of a core: with more of them at once, race control gets too little to keep time.
test-long:
	$(PYTEST) -n 6 --maxschedchunk 1 -m long $(ARGS)

soak:
	$(IN_WORKSPACE) python soak/run.py $(ARGS)

bench:
	$(IN_WORKSPACE) python bench/performance.py $(ARGS)

fuzz:
	$(IN_WORKSPACE) python fuzz/run.py $(ARGS)

# Whatever dies of the two is started again; a wrong setting or Ctrl-C ends it (evgp_node.restarting).
# The timekeeper ends with race control, which needs none; with SROS2 it has an enclave of its own.
run:
	$(IN_WORKSPACE) sh -c 'ROS_SECURITY_ENCLAVE_OVERRIDE=$${ROS_SECURITY_ENCLAVE_OVERRIDE:+/timekeeper} \
	  setpriv --pdeathsig TERM python -m evgp_node.restarting "$$1" --ros-args \
	  --params-file "$$2" -p "$$3" & shift 3; exec python -m evgp_node.restarting "$$@"' run \
	  install/evgp_timing/lib/evgp_timing/timekeeper '$(abspath $(TIMING))' 'roster:=$(abspath $(ROSTER))' \
	  install/evgp_rcs/lib/evgp_rcs/rcs_node --ros-args \
	  --params-file '$(abspath $(PARAMS))' -p 'roster:=$(abspath $(ROSTER))' \
	  $(if $(ADDRESS),-p 'address:=$(ADDRESS)')

# Paths are those on the other machine; relative ones begin in the folder that FROM names.
spare:
	$(IN_WORKSPACE) install/evgp_rcs/lib/evgp_rcs/rcs_spare '$(FROM)' \
	  --roster '$(ROSTER)' --params '$(PARAMS)' $(if $(RECORD),--record '$(RECORD)') $(ARGS)

takeover:
	$(IN_WORKSPACE) install/evgp_rcs/lib/evgp_rcs/rcs_takeover '$(ADDRESS)' '$(INTERFACE)' $(ARGS)

roster:
	@$(IN_WORKSPACE) install/evgp_rcs/lib/evgp_rcs/rcs_roster check '$(abspath $(ROSTER))'

record:
	$(IN_WORKSPACE) install/evgp_rcs/lib/evgp_rcs/rcs_record $(ARGS)

console:
	$(IN_WORKSPACE) --console install/evgp_rcs_console/lib/evgp_rcs_console/rcs_gui $(ARGS) \
	  $(if $(OFFICIAL),--ros-args -p 'official:="$(subst ",,$(OFFICIAL_QUOTED))"' --)

timekeeper:
	$(IN_WORKSPACE) --console install/evgp_timing/lib/evgp_timing/timekeeper_window $(ARGS) \
	  $(if $(OFFICIAL),--ros-args -p 'official:="$(subst ",,$(OFFICIAL_QUOTED))"' --)

# How it was called, for the command lines that it prints.
ctl: export EVGP_CTL := make ctl $(if $(OFFICIALS),OFFICIALS=$(OFFICIALS) )ARGS="%s"
ctl:
	@$(IN_WORKSPACE) install/evgp_rcs_console/lib/evgp_rcs_console/rcs_ctl $(if $(OFFICIAL),--official '$(OFFICIAL_QUOTED)') $(or $(ARGS),$(ARG),--help)

# It comes back after a crash; not where a setting is wrong.
RCS_BUTTON := install/evgp_rcs_console/lib/evgp_rcs_console/rcs_button
button:
	$(IN_WORKSPACE) $(if $(DEVICE),python -m evgp_node.restarting $(RCS_BUTTON) --ros-args \
	  -p 'device:=$(DEVICE)' \
	  $(if $(OFFICIAL),-p 'official:="$(subst ",,$(OFFICIAL_QUOTED))"') $(ARGS),$(RCS_BUTTON) test $(ARGS))

# It comes back after a failure or a crash, in RED_RED; not where a setting is wrong.
bridge:
	@if [ -z '$(HOST)' ]; then echo 'Name the address of race control: make bridge HOST=10.0.0.1' >&2; exit 2; fi
	$(IN_WORKSPACE) python -m evgp_node.restarting \
	  install/evgp_kart_bridge/lib/evgp_kart_bridge/kart_bridge_node --ros-args \
	  -p 'host:=$(HOST)' \
	  $(if $(ODOM),-r '~/odom:=$(ODOM)' -p odometry_required:=true) $(ARGS)

# It comes back after a crash; not where a setting is wrong.
timing:
	$(IN_WORKSPACE) python -m evgp_node.restarting \
	  install/evgp_timing/lib/evgp_timing/timing_source --ros-args \
	  -p 'kind:=$(KIND)' -p 'device:=$(DEVICE)' $(ARGS)

# It comes back after a crash; not where a setting is wrong.
board:
	$(IN_WORKSPACE) python -m evgp_node.restarting \
	  install/evgp_board/lib/evgp_board/board --ros-args $(if $(AT),-p 'address:=$(AT)') $(ARGS)

# Needs nothing but Python: on the computer of whoever inspects karts, nothing may be set up.
inspect-kart:
	python3 src/evgp_inspection kart $(ARGS)

# As little: on race control's computer, on the day before.
survey:
	python3 src/evgp_inspection survey $(ARGS)

# The pictures of docs/, made by the test that looks at every state of the window.
screenshots:
	EVGP_ALL_TESTS=1 EVGP_SCREENSHOTS=docs/screenshots $(IN_WORKSPACE) --console \
	  python -m pytest test/test_board.py test/test_console.py test/test_report_page.py -k screenshots

# Without the C library: text is flash, bss is memory.
kit-size:
	@object=$$(mktemp); for header in KART BOARD; do \
	  arm-none-eabi-gcc -mcpu=cortex-m0 -mthumb -std=c99 -Os -Ikit/c -DEVGP_$$header \
	    -c kit/c/test/size.c -o $$object && arm-none-eabi-size $$object; done; rm $$object

lines:
	@python3 setup/lines.py

# Every check runs, whatever those before it found.
lint:
	@failed=; \
	for check in 'python setup/headers.py' 'ruff check' 'ruff format --check' 'setup/without-ros flake8' \
	    'pydocstyle bench fuzz kit setup soak src test' mypy; do \
	  echo "$$check"; \
	  $(IN_WORKSPACE) $$check || failed=1; \
	done; \
	test -z "$$failed"

format:
	$(IN_WORKSPACE) ruff check --fix
	$(IN_WORKSPACE) ruff format

clean:
	rm -rf .venv build install log

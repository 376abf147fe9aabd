# plclink: an ordinary EPICS module, and two commands that need nothing but Debian:
#   make demo    an IOC and a simulated PLC exchange blocks before your eyes
#   make test    all tests
# There is `make demo-redundant` too: a redundant pair of PLCs, and a cable that is pulled.
# And `make demo-sync`: an IOC with the values of yesterday meets a plant that runs;
# `make demo-modbus`: setpoints over Modbus, acknowledged or refused.
# `make demo-asyn`, where ASYN is set: the same PLC as an asyn port, side by side.
# In a tree with configure/RELEASE.local (or EPICS_BASE set), plain `make` is a plain EPICS
# build and installs nothing on the machine.

TOP = .

.PHONY: demo demo-redundant demo-sync demo-asyn demo-modbus test bench

ifneq ($(words $(CURDIR)),1)
  $(error EPICS cannot build in a path with a blank: "$(CURDIR)". Move the tree)
endif

ifneq ($(filter demo demo-% test bench,$(MAKECMDGOALS)),)
  # GNU make makes this included file when it is missing, then reads it and goes on.
  include configure/RELEASE.local
  configure/RELEASE.local: ; @configure/setup.sh base

  # Each of these brings everything it needs; they are not part of the EPICS build.
  BUILD = echo "== build" && $(MAKE) -s $(if $(findstring -j,$(MAKEFLAGS)),,-j$(shell nproc)) all
  demo: ; @+$(BUILD) && exec iocBoot/iocS7plc/demo
  demo-redundant: ; @+$(BUILD) && exec iocBoot/iocPhoenix/demo
  demo-sync: ; @+$(BUILD) && exec iocBoot/iocSync/demo
  demo-asyn: ; @+$(BUILD) && exec iocBoot/iocAsyn/demo
  demo-modbus: ; @+$(BUILD) && exec iocBoot/iocModbus/demo
  test: ; @+tests/run
  bench: ; @+$(BUILD) && exec tests/bench/run
else ifeq ($(wildcard configure/RELEASE.local ../RELEASE.local)$(EPICS_BASE),)
  .DEFAULT_GOAL := missing
  .PHONY: missing
  missing:
	@echo "No EPICS Base: write EPICS_BASE = <path> into configure/RELEASE.local," >&2
	@echo "or type 'make demo' or 'make test', which find or build one." >&2
	@false
  %: missing ; @false
else
  include $(TOP)/configure/CONFIG

  DIRS += configure
  DIRS += s7plcApp phoenixRedundApp plcSim tests iocBoot
  s7plcApp_DEPEND_DIRS = configure
  phoenixRedundApp_DEPEND_DIRS = s7plcApp
  plcSim_DEPEND_DIRS = configure
  tests_DEPEND_DIRS = s7plcApp phoenixRedundApp plcSim
  iocBoot_DEPEND_DIRS = s7plcApp phoenixRedundApp

  include $(TOP)/configure/RULES_TOP
endif

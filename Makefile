# plclink: an ordinary EPICS module, and commands that need nothing but Debian.
# `make help` lists them. Plain `make` where an EPICS Base is named (configure/RELEASE) is a
# plain EPICS build and installs nothing on the machine.

TOP = .

ifneq ($(words $(CURDIR)),1)
  $(error EPICS cannot build in a path with a blank: "$(CURDIR)". Move the tree)
endif

.PHONY: help demo demo-redundant demo-sync demo-asyn demo-modbus demo-tables demo-etherip demo-map test check-all \
    soak bench docs displays fuzz coverage mutants

HELP = "make                 build (needs EPICS_BASE, see configure/RELEASE)" \
    "make rebuild         clean, then build: after an update of the sources" \
    "make clean           remove what was compiled" \
    "make distclean       remove what was compiled and installed" \
    "make demo            an IOC and a simulated PLC exchange blocks before your eyes" \
    "make demo-redundant  the cable of a PRIMARY is pulled, no record goes INVALID" \
    "make demo-sync       an IOC with the values of yesterday meets a plant that runs" \
    "make demo-modbus     setpoints over Modbus, acknowledged or refused" \
    "make demo-map        a row is added to the map of a plant; everything is made anew" \
    "make demo-tables     a row is added to the map; the IOC brings the table to the PLC" \
    "make demo-etherip    tags of a controller over EtherNet/IP" \
    "make demo-asyn       the same PLC as an asyn port (where ASYN is set)" \
    "make test            all tests" \
    "make check-all       warnings as errors, all tests under sanitizers, static analysis: hours" \
    "make soak            random faults on every transport for ten minutes, a report (DURATION= SEED=)" \
    "make bench           speed" \
    "make fuzz            all parsers with random bytes; MINUTES=<n> for each, default 0.2" \
    "make coverage        which lines and branches the tests run (SYSTEM=1: the system tests too)" \
    "make mutants         do the unit tests notice small mistakes? (SEED= COUNT=100)" \
    "make displays        pictures of the displays, by PyDM; PHOEBUS=<folder>: by Phoebus" \
    "make docs            the documents as a site in docs/O.site; each warning is an error" \
    "The demos, test, bench and docs bring all they need on Debian, an EPICS Base too."

# Where a Base is named, make reads all the files that may do it.
include configure/RELEASE

ifneq ($(filter help,$(MAKECMDGOALS)),)
  help: ; @printf '%s\n' $(HELP)
else ifneq ($(filter docs,$(MAKECMDGOALS)),)
  docs: ; @docs/build
else ifneq ($(filter demo demo-% test check-all soak bench displays fuzz coverage mutants,$(MAKECMDGOALS)),)
  ifneq ($(origin EPICS_BASE),file)
    # GNU make makes this included file when it is missing, then reads it and goes on.
    include configure/RELEASE.local
    configure/RELEASE.local: ; @configure/setup.sh base
  endif

  # Each of these brings everything it needs; they are not part of the EPICS build.
  BUILD = echo "== build" && $(MAKE) -s $(if $(findstring -j,$(MAKEFLAGS)),,-j$(shell nproc)) all
  demo: ; @+$(BUILD) && exec iocBoot/iocS7plc/demo
  demo-redundant: ; @+$(BUILD) && exec iocBoot/iocPhoenix/demo
  demo-sync: ; @+$(BUILD) && exec iocBoot/iocSync/demo
  demo-asyn: ; @+$(BUILD) && exec iocBoot/iocAsyn/demo
  demo-modbus: ; @+$(BUILD) && exec iocBoot/iocModbus/demo
  demo-map: ; @configure/setup.sh map; $(BUILD) && exec iocBoot/iocMap/demo
  demo-tables: ; @configure/setup.sh map; $(BUILD) && exec iocBoot/iocTables/demo
  demo-etherip: ; @+$(BUILD) && exec iocBoot/iocEtherIP/demo
  test: ; @+tests/run
  check-all: ; @+tests/check/run
  soak: ; @+$(BUILD) && exec tests/soak/run $(foreach v,DURATION SEED TRANSPORTS INSTANCES OUT,$(if $($v),$v=$($v)))
  bench: ; @+$(BUILD) && exec tests/bench/run
  displays: ; @+$(BUILD) && exec tests/displays/run
  fuzz: ; @tests/fuzz/run $(addprefix -m ,$(MINUTES))
  coverage: ; @tests/coverage/run $(if $(SYSTEM),--system)
  mutants: ; @tests/coverage/mutate $(addprefix --seed ,$(SEED)) $(addprefix --count ,$(COUNT))
else ifneq ($(filter rebuild,$(MAKECMDGOALS)),)
  # Compiled files remember the headers they were made from by name: after an update that
  # has moved or removed one, make stops with "No rule to make target".
  rebuild: ; @+$(MAKE) clean && $(MAKE) all
else ifeq ($(EPICS_BASE),)
  .DEFAULT_GOAL := missing
  .PHONY: missing clean distclean
  missing:
	@echo "No EPICS Base: write EPICS_BASE = <path> into configure/RELEASE.local," >&2
	@echo "or type 'make demo' or 'make test', which find or build one." >&2
	@false
  clean: ; @find . -name 'O.*' -type d -prune -exec rm -rf {} +
  distclean: clean ; @rm -rf bin lib dbd db include cfg op html doc templates
  $(filter-out clean distclean missing,$(MAKECMDGOALS)): missing
else ifeq ($(origin EPICS_BASE),environment)
  # EPICS wants to find it in a file. When that is made, make reads all anew.
  include configure/RELEASE.local
  configure/RELEASE.local: ; @configure/setup.sh release
  .DEFAULT_GOAL := unnamed
  .PHONY: unnamed
  unnamed:
	@echo "EPICS_BASE is in the environment, and configure/RELEASE.local does not name it:" >&2
	@echo "write EPICS_BASE = $(EPICS_BASE) into that file." >&2
	@false
  $(filter-out unnamed,$(MAKECMDGOALS)): unnamed
else
  include $(TOP)/configure/CONFIG

  DIRS += configure
  DIRS += s7plcApp phoenixRedundApp plcSim tests iocBoot docs
  s7plcApp_DEPEND_DIRS = configure
  phoenixRedundApp_DEPEND_DIRS = s7plcApp
  plcSim_DEPEND_DIRS = configure
  tests_DEPEND_DIRS = s7plcApp phoenixRedundApp plcSim
  iocBoot_DEPEND_DIRS = s7plcApp phoenixRedundApp
  docs_DEPEND_DIRS = configure

  include $(TOP)/configure/RULES_TOP
endif

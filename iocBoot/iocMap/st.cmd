#!../../bin/linux-x86_64/s7plcIoc
# An IOC from a map: everything that belongs to the PLC is in gen/, made by
#
#   ../../bin/linux-x86_64/plcmap generate plant -o gen
#
# `make demo-map` does it all, with a simulated PLC. For your own PLC: docs/map.md.

< envPaths
epicsEnvSet MAPDIR, "$(GEN=$(TOP)/iocBoot/iocMap/gen)"
cd "${TOP}"

dbLoadDatabase "dbd/s7plcIoc.dbd"
s7plcIoc_registerRecordDeviceDriver pdbbase

< $(MAPDIR)/plant.cmd
dbLoadRecords "db/s7plcSync.db", "P=cool:,PLC=COOLING"

iocInit

#!../../bin/linux-x86_64/s7plcIoc
# A PLC that is never edited again: what moves between its memory and the blocks is in a table
# that this IOC brings. `plcmap generate map -o gen` makes gen/map.cmd, .db and .ptr from the
# map beside this file. Two terminals in this directory:
#
#   ../../bin/linux-x86_64/plcSim tables.plc        the PLC, and its console
#   ../../bin/linux-x86_64/s7plcIoc st.cmd          this IOC, and its shell
#
# `make demo-tables` does it all. For your own PLC: docs/plc-tables.md.

< envPaths
cd "${TOP}"

dbLoadDatabase "dbd/s7plcIoc.dbd"
s7plcIoc_registerRecordDeviceDriver pdbbase

epicsEnvSet PLC1_PORT, "$(PLC_PORT=2000)"
epicsEnvSet MAPDIR, "$(GEN=iocBoot/iocTables/gen)"
< "$(MAPDIR)/map.cmd"
dbLoadRecords "db/s7plcStation.db", "P=oven:,PLC=PLC1"
dbLoadRecords "db/s7plcSync.db", "P=oven:,PLC=PLC1"
dbLoadRecords "db/s7plcTables.db", "P=oven:,PLC=PLC1"

iocInit

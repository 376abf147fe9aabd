#!../../bin/linux-x86_64/s7plcIoc
# A PLC with the sync handshake: nothing is written before the PLC agrees that the IOC holds
# its values. Two terminals in this directory:
#
#   ../../bin/linux-x86_64/plcSim sync.plc          the PLC, and its console
#   ../../bin/linux-x86_64/s7plcIoc st.cmd          this IOC, and its shell
#
# `make demo-sync` does it all. For your own PLC: docs/sync.md and docs/plc-programming.md.

< envPaths
cd "${TOP}"

dbLoadDatabase "dbd/s7plcIoc.dbd"
s7plcIoc_registerRecordDeviceDriver pdbbase

#              name  address                        port                 inSize outSize bigEndian recvTimeout sendInterval
s7plcConfigure(PLC1, "$(PLC_ADDRESS=127.0.0.1)", $(PLC_PORT=2000), 32,    12,     1,        2000,       100)

# Header and handshake; the number of the symbol map, which the PLC has too; and where the PLC
# shows our outputs. A heartbeat of 500 ms comes with sync, unless heartbeat says another.
s7plcSetOption PLC1, sync, on
s7plcSetOption PLC1, layout, 0x1201
s7plcSetOption PLC1, readback, 0

dbLoadRecords "iocBoot/iocSync/sync.db", "P=$(P=sync:),PLC=PLC1"
dbLoadRecords "db/s7plcStation.db", "P=$(P=sync:),PLC=PLC1"
dbLoadRecords "db/s7plcSync.db", "P=$(P=sync:),PLC=PLC1"
dbLoadRecords "iocBoot/iocSync/yesterday.db", "P=$(P=sync:)"

iocInit

#!../../bin/linux-x86_64/phoenixIoc
# The test set-up of the paper: "PLC-A" is a redundant pair, "PLC-B" a single PLC, both
# simulated by plcSim. Three terminals in this directory:
#
#   ../../bin/linux-x86_64/plcSim plc-a.plc          the pair, and its console
#   ../../bin/linux-x86_64/plcSim plc-b.plc          the single PLC
#   ../../bin/linux-x86_64/phoenixIoc st.cmd         this IOC, and its shell
#
# `make demo-redundant` does it all, and walks through the paper's three steps.

< envPaths
cd "${TOP}"

dbLoadDatabase "dbd/phoenixIoc.dbd"
phoenixIoc_registerRecordDeviceDriver pdbbase

# redundancy: 1 = FIRST at IPaddr, SECOND at IPaddr+1 (or "a,b": any two addresses),
#             0 = one PLC, as with s7plcConfigure
#
#                  name   IPaddr                          IPport               inSize outSize bigEndian recvTimeout sendInterval redundancy
phoenixplcConfigure(PLC-A, "$(PLC_A_ADDRESS=127.0.0.2)", $(PLC_A_PORT=2000), 64,    32,     1,        2000,       100,         1)
phoenixplcConfigure(PLC-B, "$(PLC_B_ADDRESS=127.0.0.5)", $(PLC_B_PORT=2000), 64,    32,     1,        2000,       100,         0)

# Data records are the same for a pair and for a single PLC: DTYP "S7plc"
dbLoadRecords "iocBoot/iocPhoenix/phoenix.db", "P=$(P=px:)A:,PLC=PLC-A"
dbLoadRecords "iocBoot/iocPhoenix/phoenix.db", "P=$(P=px:)B:,PLC=PLC-B"

# Who leads, is the other one ready, what happened: DTYP "phoenixplc"
dbLoadRecords "db/phoenixplcStatus.db", "P=$(P=px:)A:,PLC=PLC-A"
dbLoadRecords "db/phoenixplcStatus.db", "P=$(P=px:)B:,PLC=PLC-B"

# The health of the connections: state, reason, counters, times (docs/statistics.md)
dbLoadRecords "db/s7plcStation.db", "P=$(P=px:)A:,PLC=PLC-A"
dbLoadRecords "db/s7plcStation.db", "P=$(P=px:)B:,PLC=PLC-B"

iocInit

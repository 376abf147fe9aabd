#!../../bin/linux-x86_64/s7plcIoc
# The tutorial: one PLC, simulated by plcSim. Two terminals in this directory:
#
#   ../../bin/linux-x86_64/plcSim example.plc       the PLC, and its console
#   ../../bin/linux-x86_64/s7plcIoc st.cmd          this IOC, and its shell
#
# For your own PLC change the s7plcConfigure line and the records in example.db.

< envPaths
cd "${TOP}"

dbLoadDatabase "dbd/s7plcIoc.dbd"
s7plcIoc_registerRecordDeviceDriver pdbbase

# The PLC sends blocks of inSize bytes and takes blocks of outSize bytes. bigEndian: 1 for
# Siemens (most significant byte first). recvTimeout: the PLC counts as gone when no block
# came for so long. sendInterval: two blocks to the PLC are at least this far apart.
#
#              name  address                        port                 inSize outSize bigEndian recvTimeout sendInterval
s7plcConfigure(PLC1, "$(PLC_ADDRESS=127.0.0.1)", $(PLC_PORT=2000), 256,   128,    1,        2000,       100)

# Options have good defaults; `s7plcSetOption` alone lists them. This PLC's program wants a
# block at least every 500 ms, changed or not.
s7plcSetOption PLC1, heartbeat, 500

# Every record type and every data type once
dbLoadRecords "iocBoot/iocS7plc/example.db", "P=$(P=s7:),PLC=PLC1"

# The usual cases need no record of your own: s7plcApp/Db has templates for them
dbLoadRecords "db/s7plcStatus.template", "P=$(P=s7:)PLC1:,PLC=PLC1"
dbLoadRecords "db/s7plcAnalogIn.template", "NAME=$(P=s7:)Pressure,PLC=PLC1,OFFS=112,T=REAL32,EGU=mbar,PREC=1"

# The health of the connection: state, counters, times (docs/statistics.md)
dbLoadRecords "db/s7plcStation.db", "P=$(P=s7:)PLC1:,PLC=PLC1"

iocInit

#!../../bin/linux-x86_64/s7plcAsynIoc
# One PLC by DTYP "S7plc" and by asyn, side by side. plcSim plays the PLC. Two terminals in
# this directory:
#
#   ../../bin/linux-x86_64/plcSim asyn.plc             the PLC, and its console
#   ../../bin/linux-x86_64/s7plcAsynIoc st.cmd         this IOC, and its shell
#
# s7plcAsynIoc is built where ASYN is set in configure/RELEASE.local.

< envPaths
cd "${TOP}"

dbLoadDatabase "dbd/s7plcAsynIoc.dbd"
s7plcAsynIoc_registerRecordDeviceDriver pdbbase

#              name  address                        port                 inSize outSize bigEndian recvTimeout sendInterval
s7plcConfigure(PLC1, "$(PLC_ADDRESS=127.0.0.1)", $(PLC_PORT=2000), 64,    32,     1,        2000,       100)

# The PLC as an asyn port, in addition. After the line above, before iocInit.
drvAsynS7plcConfigure(PLC1-asyn, PLC1)

dbLoadRecords "iocBoot/iocAsyn/asyn.db", "P=$(P=as:),PLC=PLC1,PORT=PLC1-asyn"
dbLoadRecords "db/s7plcStatus.template", "P=$(P=as:),PLC=PLC1"
dbLoadRecords "db/s7plcStation.db", "P=$(P=as:),PLC=PLC1"

iocInit

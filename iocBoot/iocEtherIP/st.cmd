#!../../bin/linux-x86_64/s7plcIoc
# EtherNet/IP: tags of a controller, with the links of ether_ip (docs/etherip.md). Two terminals in
# this directory:
#
#   ../../bin/linux-x86_64/plcSim controller.plc
#   ../../bin/linux-x86_64/s7plcIoc st.cmd

< envPaths
cd "${TOP}"

dbLoadDatabase "dbd/s7plcIoc.dbd"
s7plcIoc_registerRecordDeviceDriver pdbbase

#                     name  ip[:port]                                           slot
drvEtherIP_define_PLC(CTRL, "$(PLC_ADDRESS=127.0.0.1):$(PLC_PORT=44818)", 0)

dbLoadTemplate "iocBoot/iocEtherIP/load.substitutions", "P=$(P=eip:)"
dbLoadRecords "iocBoot/iocEtherIP/etherip.db", "P=$(P=eip:)"
dbLoadRecords "db/eip_stat.db", "IOC=$(P=eip:)CTRL,PLC=CTRL,TAG=BOOLs S 0.1"
dbLoadRecords "db/s7plcStation.db", "P=$(P=eip:)CTRL:,PLC=CTRL"
dbLoadRecords "db/s7plcModbus.db",  "P=$(P=eip:)CTRL:,PLC=CTRL"

iocInit

#!../../bin/linux-x86_64/s7plcIoc
# Modbus/TCP: a PLC whose setpoints go that way, and a device that speaks nothing else
# (docs/modbus.md). Three terminals in this directory:
#
#   ../../bin/linux-x86_64/plcSim press.plc
#   ../../bin/linux-x86_64/plcSim chiller.plc
#   ../../bin/linux-x86_64/s7plcIoc st.cmd

< envPaths
cd "${TOP}"

dbLoadDatabase "dbd/s7plcIoc.dbd"
s7plcIoc_registerRecordDeviceDriver pdbbase

# PRESS sends blocks of 64 bytes. Its 32 bytes of output are holding registers 1000 to 1015.
#              name   address                        port                 inSize outSize bigEndian recvTimeout sendInterval
s7plcConfigure(PRESS, "$(PLC_ADDRESS=127.0.0.1)", $(PLC_PORT=2000), 64,    32,     1,        2000,       100)
#                 name   address  port                     unit startRegister
s7plcModbusOutput(PRESS, "",      $(MODBUS_PORT=1502), 1,   1000)

# CHILLER is polled
#                  name     address                            port
modbusplcConfigure(CHILLER, "$(CHILLER_ADDRESS=127.0.0.1)", $(CHILLER_PORT=1503), 1, "input 0 32 every 100, holding 0 32 every 200, discrete 0 16 every 100", "holding 0 32, coils 0 16")
s7plcSetOption CHILLER, scan, changed

dbLoadRecords "iocBoot/iocModbus/modbus.db", "P=$(P=modbus:)"
dbLoadRecords "db/s7plcStation.db", "P=$(P=modbus:)PRESS:,PLC=PRESS"
dbLoadRecords "db/s7plcModbus.db",  "P=$(P=modbus:)PRESS:,PLC=PRESS"
dbLoadRecords "db/s7plcStation.db", "P=$(P=modbus:)CHILLER:,PLC=CHILLER"
dbLoadRecords "db/s7plcModbus.db",  "P=$(P=modbus:)CHILLER:,PLC=CHILLER"

iocInit

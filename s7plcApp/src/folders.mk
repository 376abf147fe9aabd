# The folders of this library, from the ground up. Other libraries and the unit tests include
# this file for their -I lines.
S7PLC_FOLDERS = value tcp image scan station block record shell
S7PLC_DIRS = $(TOP)/s7plcApp/src $(addprefix $(TOP)/s7plcApp/src/,$(S7PLC_FOLDERS)) $(TOP)/s7plcApp/modbus

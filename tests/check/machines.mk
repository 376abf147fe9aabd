# The pure parts of plclink with their unit tests, for another machine, by a cross compiler; libCom
# from the sources of EPICS Base as far as they need it. Called by tests/check/machines and, for this
# machine, tests/coverage/mutate, which say TOP, EPICS_BASE (built from source), OUT and CROSS, as
# powerpc-linux-gnu.
include $(TOP)/s7plcApp/src/FOLDERS
include $(TOP)/plcSim/FOLDERS

CC = $(CROSS)-gcc
CXX = $(CROSS)-g++
DIRS = $(S7PLC_DIRS) $(TOP)/s7plcApp/modbus $(TOP)/s7plcApp/etherip $(TOP)/phoenixRedundApp/src \
    $(addprefix $(TOP)/plcSim/,$(PLCSIM_FOLDERS)) $(TOP)/tests/unit
CPPFLAGS = -D_GNU_SOURCE -DUNIX -Dlinux -DUSE_TYPED_DSET -DUSE_TYPED_RSET $(addprefix -I,$(DIRS)) \
    $(addprefix -isystem ,$(addprefix $(EPICS_BASE)/include,/compiler/gcc /os/Linux) \
    $(EPICS_BASE)/include $(LIBCOM)/osi)
CFLAGS = -g -O2 -std=gnu99 -Wall -Wextra -Wno-unused-parameter -Wno-expansion-to-defined -Werror

LIBCOM = $(EPICS_BASE)/modules/libcom/src
COM_DIRS = $(wildcard $(addprefix $(LIBCOM)/,bucketLib cvtFast cxxTemplates dbmf ellLib env error \
    fdmgr freeList gpHash log macLib misc pool ring taskwd timer calc osi osi/os/Linux osi/os/posix \
    osi/os/default osi/compiler/gcc osi/compiler/default))
COM_SRCS = $(wildcard $(addsuffix /*.c,$(COM_DIRS)) $(addsuffix /*.cpp,$(COM_DIRS)))
# Of files of one name the one for the nearest system counts: VPATH has their order.
COM_OBJS = $(sort $(addprefix $(OUT)/com/,$(addsuffix .o,$(basename $(notdir $(COM_SRCS))))))
# No mutexes with priority inheritance: the kernel looks for their owner's number in the byte order of
# this machine, and says "no such process" to qemu's; then who waits for one waits for ever.
COM_FLAGS = -g -O1 -w -DDONT_USE_POSIX_THREAD_PRIORITY_SCHEDULING -D_GNU_SOURCE -DUNIX -Dlinux $(addprefix -I,$(OUT)/com \
    $(LIBCOM)/osi/os/Linux $(LIBCOM)/osi/os/posix $(LIBCOM)/osi/os/default $(COM_DIRS)) \
    $(addprefix -I,$(EPICS_BASE)/include $(EPICS_BASE)/include/os/Linux \
    $(EPICS_BASE)/include/compiler/gcc)

VPATH = $(LIBCOM)/osi/os/Linux:$(LIBCOM)/osi/os/posix:$(LIBCOM)/osi/os/default \
    $(COM_DIRS) $(DIRS)

codecTest = plcCodec
clockTest = plcClock plcCodec
linkTest = plcLink plcLinkComplete plcOtherTypes plcCodec
pointersTest = plcPointers
statsTest = plcStats
putsTest = plcPuts plcPutEntry
faultsTest = plcFaults

imageTest = plcImage plcImageOut plcPuts plcPutEntry
readbackTest = plcReadback plcImage plcImageOut plcPuts plcPutEntry
framingTest = framingTestSlip plcFraming
roleTest = pairRole
syncTest = plcSync plcCodec
tablesTest = plcTables plcSync plcPointers plcCodec simConfig simLog simMemory simSignal simValue \
    simTables simTablesRow
modbusPlanTest = plcModbusPlan plcModbusRanges
modbusFrameTest = plcModbusFrame plcModbusPlan plcModbusRanges
eipFrameTest = eipConnect eipSession eipCip eipFrame
eipTagsTest = plcFaults eipLink eipName eipPlaces eipPlan eipTags eipUnits eipBrowse eipType eipCip eipFrame
eipRareTest = eipConnect eipSession eipBrowse eipType eipCip eipFrame
eipUnitsTest = $(eipTagsTest)
plcSimTestMemory = simConfig simLog simMemory simSignal simValue
TESTS = imageTest codecTest clockTest linkTest pointersTest statsTest putsTest faultsTest \
    readbackTest framingTest roleTest syncTest tablesTest modbusPlanTest eipFrameTest eipTagsTest \
    eipRareTest eipUnitsTest modbusFrameTest \
    plcSimTestMemory

all: $(addprefix $(OUT)/,$(TESTS))

# The table of error numbers is made by Base's build: an empty one will do here.
$(OUT)/com/errors.o:
	@mkdir -p $(OUT)/com
	@printf '%s\n' '#include "errMdef.h"' '#include "errSymTbl.h"' \
	    'static ERRSYMTAB none = {0}; ERRSYMTAB_ID errSymTbl = &none;' \
	    'void iocshRegister(void) {}' >$(OUT)/com/errors.c
	@$(CC) $(COM_FLAGS) -c -o $@ $(OUT)/com/errors.c

# What the tests do not need of libCom may fail to compile.
$(OUT)/com/%.o: %.c
	@mkdir -p $(OUT)/com
	@$(CC) $(COM_FLAGS) -std=gnu99 -c -o $@ $< 2>$@.log || { $(CC) -x c -c -o $@ /dev/null; }

$(OUT)/com/%.o: %.cpp
	@mkdir -p $(OUT)/com
	@$(CXX) $(COM_FLAGS) -c -o $@ $< 2>$@.log || { $(CC) -x c -c -o $@ /dev/null; }

$(OUT)/libCom.a: $(COM_OBJS) $(OUT)/com/errors.o
	@rm -f $@
	@ar rcs $@ $^

$(OUT)/%.o: %.c
	@mkdir -p $(OUT)
	@$(CC) $(CFLAGS) $(CPPFLAGS) -c -o $@ $<

define program
$(OUT)/$(1): $(addprefix $(OUT)/,$(addsuffix .o,$(1) $($(1)))) $(OUT)/libCom.a
	@$(CXX) -static -o $$@ $$^ -lm -lpthread -ldl -lrt
endef
$(foreach test,$(TESTS),$(eval $(call program,$(test))))

.PHONY: all list parts flags
list: ; @echo $(TESTS)
# Each test with the parts that it is linked with
parts: ; @printf '%s\n' $(foreach test,$(TESTS),'$(test): $($(test))')
# How one part is compiled
flags: ; @printf '%s\n' '$(CC) $(CFLAGS) $(CPPFLAGS)'

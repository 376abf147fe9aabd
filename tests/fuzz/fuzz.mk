# The fuzz targets for libFuzzer, with all of the driver and the simulator under the address and
# undefined behaviour sanitizers, in a folder of its own. Called by tests/fuzz/run, which says
# TOP, EPICS_BASE, HOST_ARCH and OUT.
include $(TOP)/s7plcApp/src/FOLDERS
include $(TOP)/plcSim/FOLDERS
include $(TOP)/configure/CONFIG_PLCLINK_VERSION
HERE = $(TOP)/tests/fuzz

DRIVER_DIRS = $(S7PLC_DIRS) $(TOP)/s7plcApp/modbus $(TOP)/s7plcApp/etherip
SIM_DIRS = $(addprefix $(TOP)/plcSim/,$(PLCSIM_FOLDERS))
SRCS = $(filter-out %/plcTag.c,$(wildcard $(addsuffix /*.c,$(DRIVER_DIRS))))
SRCS += $(TOP)/s7plcApp/asyn/plcAsynPlace.c
SRCS += $(TOP)/plcSim/simServers.c $(wildcard $(addsuffix /*.c,$(SIM_DIRS)))
SRCS += $(filter-out %/fuzzMain.c %/fuzzSeedTest.c,$(wildcard $(HERE)/*.c))
OBJS = $(addprefix $(OUT)/,$(notdir $(SRCS:.c=.o)))
TARGETS = $(shell sed -n 's/^ *{"\([A-Za-z]*\)", .*/\1/p' $(HERE)/fuzzTargets.c)

CC = clang
SANITIZE = address,undefined,float-cast-overflow
CFLAGS = -g -O1 -fno-omit-frame-pointer -std=gnu99 -fsanitize=$(SANITIZE) \
    -fno-sanitize-recover=all -Wall -Wno-unused-parameter -Werror=implicit-function-declaration
CPPFLAGS = -D_GNU_SOURCE -DUSE_TYPED_DSET -DUSE_TYPED_RSET -DPLCSIM_MODBUS -DFUZZ_MODBUS \
    -DPLCLINK_VERSION=$(PLCLINK_VERSION) \
    $(addprefix -I,$(HERE) $(DRIVER_DIRS) $(TOP)/s7plcApp/asyn $(TOP)/plcSim $(SIM_DIRS)) \
    $(addprefix -isystem,$(EPICS_BASE)/include $(EPICS_BASE)/include/os/Linux \
    $(firstword $(wildcard $(addprefix $(EPICS_BASE)/include/compiler/,clang gcc))))
LIBS = -L$(EPICS_BASE)/lib/$(HOST_ARCH) -Wl,-rpath,$(EPICS_BASE)/lib/$(HOST_ARCH) \
    -ldbRecStd -ldbCore -lca -lCom -lmodbus -lm -lpthread

VPATH = $(sort $(dir $(SRCS)))

all: $(addprefix $(OUT)/bin/,$(TARGETS))

$(OUT)/%.o: %.c
	$(CC) $(CFLAGS) -fsanitize=fuzzer-no-link $(CPPFLAGS) -MMD -MP -c -o $@ $<

$(OUT)/liball.a: $(OBJS)
	@rm -f $@
	@ar rcs $@ $(OBJS)

$(OUT)/bin/%: $(HERE)/fuzzMain.c $(OUT)/liball.a
	@mkdir -p $(OUT)/bin
	$(CC) $(CFLAGS) -fsanitize=fuzzer -DFUZZ_TARGET=fuzz$* $(CPPFLAGS) -o $@ $< $(OUT)/liball.a $(LIBS)

-include $(OBJS:.o=.d)

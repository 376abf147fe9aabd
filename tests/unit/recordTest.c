/* See recordTest.h. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <dbAccess.h>
#include <dbChannel.h>
#include <dbStaticLib.h>
#include <dbUnitTest.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>
#include <epicsMutex.h>
#include <epicsUnitTest.h>
#include <epicsVersion.h>
#include <errlog.h>
#include <recGbl.h> /* HAS_ALARM_MESSAGE */

#include "plcBlocks.h"
#include "recordTest.h"

#define TEXT_MAX 4000
#define ARRAY_MAX 64

int recordTest_registerRecordDeviceDriver(struct dbBase *base);

static char log_[20000];
static epicsMutexId logLock; /* the listener is called in a thread of errlog */

static void listen_(void *arg, const char *message)
{
    (void)arg;
    epicsMutexMustLock(logLock);
    strncat(log_, message, sizeof(log_) - strlen(log_) - 1);
    epicsMutexUnlock(logLock);
}

const char *messages(void)
{
    static char copy[sizeof(log_)];

    errlogFlush();
    epicsMutexMustLock(logLock);
    strcpy(copy, log_);
    log_[0] = 0;
    epicsMutexUnlock(logLock);
    return copy;
}

/* --- The IOC ------------------------------------------------------------------------ */

void iocBegin(void)
{
    errlogInit2(65536, 1024); /* no message is lost, however busy the machine */
    testdbPrepare();
    testdbReadDatabase("recordTest.dbd", NULL, NULL);
    recordTest_registerRecordDeviceDriver(pdbbase);
    eltc(0);
    if (!logLock)
        logLock = epicsMutexMustCreate();
    errlogAddListener(listen_, NULL);
    messages();
}

void iocRunOk(void)
{
    testIocInitOk();
}

void iocEnd(void)
{
    testIocShutdownOk();
    plcStationsStop();
    testdbCleanup();
    plcStationsDestroy();
    errlogFlush();
    errlogRemoveListeners(listen_, NULL);
    eltc(1);
}

plcStation *makeStation(const char *name, int bigEndian, size_t inSize, size_t outSize)
{
    plcStationConfig config = {.transport = &plcBlocks};

    config.name = name;
    config.address[0] = config.address[1] = "";
    config.inSize = inSize;
    config.outSize = outSize;
    config.bigEndian = bigEndian;
    config.recvTimeout = 60000;
    config.sendInterval = 100;
    config.policy = &plcSingle;
    return plcStationCreate(&config);
}

/* Sets one "FIELD=value" of the record that the entry is at. */
static void setField(DBENTRY *entry, const char *record, char *text)
{
    char *value = strchr(text, '=');

    if (!value)
        testAbort("%s: no = in \"%s\"", record, text);
    *value++ = 0;
    if (dbFindField(entry, text) || dbPutString(entry, value))
        testAbort("%s: cannot set %s to \"%s\"", record, text, value);
}

void makeRecord(const char *type, const char *name, const char *fields)
{
    char *copy = epicsStrDup(fields), *next, *field;
    char dtyp[] = "DTYP=S7plc";
    DBENTRY entry;

    dbInitEntry(pdbbase, &entry);
    if (dbFindRecordType(&entry, type) || dbCreateRecord(&entry, name))
        testAbort("cannot make %s \"%s\"", type, name);
    if (!strstr(fields, "DTYP="))
        setField(&entry, name, dtyp);
    for (field = copy; field && *field; field = next) {
        next = strchr(field, '|');
        if (next)
            *next++ = 0;
        if (*field)
            setField(&entry, name, field);
    }
    dbFinishEntry(&entry);
    free(copy);
}

const char *linkField(const char *type)
{
    static const char *const outputs[] = {
        "ao",      "aao",       "bo",  "calcout", "int64out",
        "longout", "stringout", "lso", "mbbo",    "mbboDirect",
    };
    size_t i;

    for (i = 0; i < COUNT(outputs); i++)
        if (strcmp(type, outputs[i]) == 0)
            return "OUT";
    return "INP";
}

void publish(plcStation *station, const void *block, unsigned seconds)
{
    epicsTimeStamp stamp = {seconds, 0};

    plcImagePublish(plcStationInput(station), block, &stamp);
}

/* --- Fields ------------------------------------------------------------------------- */

static int isLong(const DBADDR *addr)
{
    return (addr->field_type == DBF_STRING && addr->field_size != MAX_STRING_SIZE) ||
           (addr->field_type >= DBF_INLINK && addr->field_type <= DBF_FWDLINK);
}

/* Splits "1,2,3". Returns the number of elements. */
static long split(const char *text, char elements[ARRAY_MAX][MAX_STRING_SIZE])
{
    long n = 0;

    while (n < ARRAY_MAX) {
        size_t length = strcspn(text, ",");

        memcpy(elements[n], text, length);
        elements[n++][length] = 0;
        if (!text[length])
            break;
        text += length + 1;
    }
    return n;
}

/* A long string (lsi, lso, links) is a field of characters with a $ behind its name. */
static dbChannel *longChannel(const char *pv)
{
    char name[80];
    dbChannel *channel;

    epicsSnprintf(name, sizeof(name), "%s%s$", pv, strchr(pv, '.') ? "" : ".VAL");
    channel = dbChannelCreate(name);
    if (!channel || dbChannelOpen(channel))
        testAbort("no field %s", name);
    return channel;
}

static long putLong(const char *pv, const char *text)
{
    dbChannel *channel = longChannel(pv);
    long status = dbChannelPutField(channel, DBR_CHAR, text, (long)strlen(text) + 1);

    dbChannelDelete(channel);
    return status;
}

static void getLong(const char *pv, char *text, size_t size)
{
    dbChannel *channel = longChannel(pv);
    long n = (long)size - 1;

    if (dbChannelGetField(channel, DBR_CHAR, text, NULL, &n, NULL))
        strcpy(text, "cannot be read");
    dbChannelDelete(channel);
}

/* Until 7.0.6 an mbboDirect makes VAL of its bits when it processes: a put to VAL is lost, and who
 * has such a Base puts the bits. */
static int isBits(const DBADDR *addr)
{
    return EPICS_VERSION_INT < VERSION_INT(7, 0, 6, 1) &&
           strcmp(addr->precord->rdes->name, "mbboDirect") == 0 &&
           strcmp(addr->pfldDes->name, "VAL") == 0;
}

static long putBits(const char *pv, unsigned long value)
{
    char name[80];
    long status = 0;
    unsigned i;

    for (i = 0; i < 32; i++) {
        epicsSnprintf(name, sizeof(name), "%.*s.B%X", (int)strcspn(pv, "."), pv, i);
        status = put(name, value >> i & 1 ? "1" : "0");
    }
    return status;
}

long put(const char *pv, const char *text)
{
    static char elements[ARRAY_MAX][MAX_STRING_SIZE];
    epicsUInt16 choice = (epicsUInt16)atoi(text);
    DBADDR addr;

    if (dbNameToAddr(pv, &addr))
        testAbort("no field %s", pv);
    if (isLong(&addr))
        return putLong(pv, text);
    if (isBits(&addr))
        return putBits(pv, strtoul(text, NULL, 10));
    if (addr.no_elements > 1)
        return dbPutField(&addr, DBR_STRING, elements, split(text, elements));
    if (addr.field_type == DBF_ENUM)
        return dbPutField(&addr, DBR_USHORT, &choice, 1);
    memset(elements, 0, sizeof(elements[0]));
    strncpy(elements[0], text, MAX_STRING_SIZE - 1);
    return dbPutField(&addr, DBR_STRING, elements, 1);
}

/* Numbers of a field, not as DBR_STRING: that depends on PREC and on state names. */
static const char *getDoubles(DBADDR *addr, long n, char *text, size_t size)
{
    double values[ARRAY_MAX];
    size_t used = 0;
    long i;

    if (dbGetField(addr, DBR_DOUBLE, values, NULL, &n, NULL))
        return "cannot be read";
    for (i = 0; i < n && used < size; i++)
        used += (size_t)epicsSnprintf(text + used, size - used, "%s%.15g", i ? "," : "",
                                      values[i]);
    return text;
}

const char *get(const char *pv)
{
    static char text[TEXT_MAX], elements[ARRAY_MAX][MAX_STRING_SIZE];
    DBADDR addr;
    long n, i;

    if (dbNameToAddr(pv, &addr))
        testAbort("no field %s", pv);
    memset(text, 0, sizeof(text));
    n = addr.no_elements < ARRAY_MAX ? addr.no_elements : ARRAY_MAX;
    if (isLong(&addr)) {
        getLong(pv, text, sizeof(text));
        return text;
    }
    if (addr.field_type == DBF_FLOAT || addr.field_type == DBF_DOUBLE ||
        addr.field_type == DBF_ENUM)
        return getDoubles(&addr, n, text, sizeof(text));
    if (dbGetField(&addr, DBR_STRING, elements, NULL, &n, NULL))
        return "cannot be read";
    for (i = 0; i < n; i++) {
        size_t used = strlen(text);

        epicsSnprintf(text + used, sizeof(text) - used, "%s%s", i ? "," : "",
                      elements[i]);
    }
    return text;
}

/* Two texts of the same number, but for rounding? Whole numbers must be the same text. */
static int sameNumber(const char *a, const char *b)
{
    double x, y;

    if (!strpbrk(b, ".enN") || epicsParseDouble(a, &x, NULL) ||
        epicsParseDouble(b, &y, NULL))
        return 0;
    return (isnan(x) && isnan(y)) || x == y || fabs(x - y) <= 1e-9 * fabs(y);
}

void isValue(const char *pv, const char *expected, const char *title)
{
    const char *value = get(pv);
    int ok = strcmp(value, expected) == 0 || sameNumber(value, expected);

    testOk(ok, "%s", title);
    if (!ok)
        testDiag("%s is \"%s\", not \"%s\"", pv, value, expected);
}

#ifdef HAS_ALARM_MESSAGE
static const char *messageOf(const char *record)
{
    char pv[80];

    epicsSnprintf(pv, sizeof(pv), "%s.AMSG", record);
    return get(pv);
}

void isMessage(const char *record, const char *expected, const char *title)
{
    const char *message = messageOf(record);
    int ok = strcmp(message, expected) == 0;

    testOk(ok, "%s", title);
    if (!ok)
        testDiag("%s.AMSG is \"%s\", not \"%s\"", record, message, expected);
}

void saysWhy(const char *record)
{
    testOk(messageOf(record)[0] != 0, "%s says why: %s", record, messageOf(record));
}

int isReason(const char *record, const char *expected)
{
    return strcmp(messageOf(record), expected) == 0;
}
#else
void isMessage(const char *record, const char *expected, const char *title)
{
    testSkip(1, "this Base has no AMSG");
}

void saysWhy(const char *record)
{
    testSkip(1, "this Base has no AMSG");
}

int isReason(const char *record, const char *expected)
{
    return 1;
}
#endif

/* --- Bytes -------------------------------------------------------------------------- */

size_t unhex(const char *hex, epicsUInt8 *bytes)
{
    size_t n;

    for (n = 0; hex[2 * n]; n++) {
        unsigned byte;

        if (sscanf(hex + 2 * n, "%2x", &byte) != 1)
            testAbort("\"%s\" is no hex text", hex);
        bytes[n] = (epicsUInt8)byte;
    }
    return n;
}

void isOutput(plcStation *station, size_t offset, const char *hex, const char *title)
{
    epicsUInt8 expected[TEXT_MAX], bytes[TEXT_MAX];
    size_t i, n = unhex(hex, expected);
    char text[2 * TEXT_MAX + 1] = "";
    int ok;

    plcImagePeek(plcStationOutput(station), offset, n, bytes);
    ok = memcmp(bytes, expected, n) == 0;
    testOk(ok, "%s", title);
    for (i = 0; !ok && i < n; i++)
        sprintf(text + 2 * i, "%02x", bytes[i]);
    if (!ok)
        testDiag("bytes are %s, not %s", text, hex);
}

void setOutput(plcStation *station, size_t offset, const char *hex)
{
    epicsUInt8 bytes[TEXT_MAX];
    size_t n = unhex(hex, bytes);

    plcImageWrite(plcStationOutput(station), offset, n, bytes, NULL, NULL);
}

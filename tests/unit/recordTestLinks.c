/* Links: what is refused and how it is told, what is only warned of, and links that
 * change at run time, for every record type.
 */
#include <string.h>

#include <dbAccess.h>
#include <dbScan.h>
#include <dbUnitTest.h>
#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "recordTest.h"

/* --- Messages ----------------------------------------------------------------------- */

static const struct {
    const char *title;
    const char *record, *fields;
    const char *message; /* the whole of it; %s is the record's name */
    const char *amsg;
} refused[] = {
    {"a type that does not exist", "ai", "INP=@P/8 T=FLOT",
     "S7plc ai \"%s\" INP: T=FLOT is no data type; allowed: INT8 UINT8 INT16 UINT16 INT32 "
     "UINT32 INT64 UINT64 REAL32 REAL64 STRING TIME S7STRING BCD16 BCD32 SM16 SBCD16\n"
     "    @P/8 T=FLOT\n"
     "           ^\n",
     "T=FLOT is no data type"},
    {"a type that the record cannot hold", "longin", "INP=@P/8 T=INT64",
     "S7plc longin \"%s\" INP: T=INT64 does not fit longin; allowed: INT8 UINT8 INT16 UINT16 "
     "INT32 UINT32 BCD16 BCD32 SM16 SBCD16\n"
     "    @P/8 T=INT64\n"
     "         ^\n",
     "T=INT64 does not fit longin"},
    {"a type that FTVL cannot hold", "waveform", "INP=@P/8 T=INT16|FTVL=LONG|NELM=2",
     "S7plc waveform \"%s\" INP: T=INT16 does not fit FTVL=LONG; allowed: INT32 UINT32\n"
     "    @P/8 T=INT16\n"
     "         ^\n",
     "T=INT16 does not fit FTVL=LONG"},
    {"FTVL=STRING", "aai", "INP=@P/8|FTVL=STRING|NELM=2",
     "S7plc aai \"%s\" INP: FTVL=STRING is not possible; allowed: FTVL=CHAR with T=STRING, "
     "numbers\n"
     "    @P/8\n"
     "       ^\n",
     "FTVL=STRING is not possible"},
    {"a PLC that does not exist", "ao", "OUT=@Q/8",
     "S7plc ao \"%s\" OUT: no PLC \"Q\"; configured: P NoIn\n"
     "    @Q/8\n"
     "     ^\n",
     "no PLC \"Q\""},
    {"a PLC in other letters", "ao", "OUT=@p/8",
     "S7plc ao \"%s\" OUT: no PLC \"p\"; configured: P NoIn\n"
     "    @p/8\n"
     "     ^\n",
     "no PLC \"p\""},
    {"an offset behind the block", "longin", "INP=@P/64",
     "S7plc longin \"%s\" INP: 64 + 2 bytes exceed the input block; inSize is 64\n"
     "    @P/64\n"
     "       ^\n",
     "64 + 2 bytes exceed the input block"},
    {"a value half behind the block", "ao", "OUT=@P/29 T=REAL32",
     "S7plc ao \"%s\" OUT: 29 + 4 bytes exceed the output block; outSize is 32\n"
     "    @P/29 T=REAL32\n"
     "       ^\n",
     "29 + 4 bytes exceed the output block"},
    {"an offset over 65535", "ai", "INP=@P/65537",
     "S7plc ai \"%s\" INP: 65537 + 2 bytes exceed the input block; inSize is 64\n"
     "    @P/65537\n"
     "       ^\n",
     "65537 + 2 bytes exceed the input block"},
    {"a waveform longer than the block", "waveform", "INP=@P/60|FTVL=SHORT|NELM=3",
     "S7plc waveform \"%s\" INP: 60 + 6 bytes exceed the input block; inSize is 64\n"
     "    @P/60\n"
     "       ^\n",
     "60 + 6 bytes exceed the input block"},
    {"an input of a PLC that sends nothing", "ai", "INP=@NoIn/0",
     "S7plc ai \"%s\" INP: the PLC has no input block; inSize is 0\n"
     "    @NoIn/0\n"
     "          ^\n",
     "the PLC has no input block"},
    {"a read-back place behind the input block", "ao", "OUT=@P/0 R=63",
     "S7plc ao \"%s\" OUT: 63 + 2 bytes exceed the input block; inSize is 64\n"
     "    @P/0 R=63\n"
     "         ^\n",
     "63 + 2 bytes exceed the input block"},
    {"a bit that the type has not", "bi", "INP=@P/0 T=BYTE B=8",
     "S7plc bi \"%s\" INP: B=8: UINT8 has bits 0 to 7\n"
     "    @P/0 T=BYTE B=8\n"
     "                ^\n",
     "B=8: UINT8 has bits 0 to 7"},
    {"mbbi with bits that the type has not", "mbbi", "INP=@P/0 T=BYTE|NOBT=2|SHFT=8",
     "S7plc mbbi \"%s\" INP: NOBT=2 SHFT=8: UINT8 has bits 0 to 7\n"
     "    @P/0 T=BYTE\n"
     "         ^\n",
     "NOBT=2 SHFT=8: UINT8 has bits 0 to 7"},
    {"mbbo with one bit too many", "mbbo", "OUT=@P/0 T=BYTE|NOBT=3|SHFT=6",
     "S7plc mbbo \"%s\" OUT: NOBT=3 SHFT=6: UINT8 has bits 0 to 7\n"
     "    @P/0 T=BYTE\n"
     "         ^\n",
     "NOBT=3 SHFT=6: UINT8 has bits 0 to 7"},
    {"mbboDirect that would write half", "mbboDirect", "OUT=@P/2 T=BYTE|NOBT=16",
     "S7plc mbboDirect \"%s\" OUT: NOBT=16 SHFT=0: UINT8 has bits 0 to 7\n"
     "    @P/2 T=BYTE\n"
     "         ^\n",
     "NOBT=16 SHFT=0: UINT8 has bits 0 to 7"},
    {"bits far away", "mbbi", "INP=@P/0 T=DWORD|NOBT=1|SHFT=65535",
     "S7plc mbbi \"%s\" INP: NOBT=1 SHFT=65535: UINT32 has bits 0 to 31\n"
     "    @P/0 T=DWORD\n"
     "         ^\n",
     "NOBT=1 SHFT=65535: UINT32 has bits 0 t"},
    {"no link at all", "ai", "",
     "S7plc ai \"%s\" INP: no PLC name; allowed: @PLCname/offset T=type ...\n"
     "    @\n"
     "     ^\n",
     "no PLC name"},
    {"the place of an error in a long link", "ai",
     "INP=@P/0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0 "
     "T=NO",
     "S7plc ai \"%s\" INP: T=NO is no data type; allowed: INT8 UINT8 INT16 UINT16 INT32 "
     "UINT32 INT64 UINT64 REAL32 REAL64 STRING TIME S7STRING BCD16 BCD32 SM16 SBCD16\n"
     "    ...0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0+0 T=NO\n"
     "                                               ^\n",
     "T=NO is no data type"},
    {"stat of a PLC that does not exist", "bi", "DTYP=S7plc stat|INP=@Q",
     "S7plc stat bi \"%s\" INP: no PLC \"Q\"; configured: P NoIn\n"
     "    @Q\n"
     "     ^\n",
     "no PLC \"Q\""},
    {"addr of a PLC that does not exist", "stringout", "DTYP=S7plc addr|OUT=@Q",
     "S7plc addr stringout \"%s\" OUT: no PLC \"Q\"; configured: P NoIn\n"
     "    @Q\n"
     "     ^\n",
     "no PLC \"Q\""},
};

static const struct {
    const char *title;
    const char *record, *fields;
    const char *message;
} warned[] = {
    {"an octal offset", "ai", "INP=@P/010",
     "S7plc ai \"%s\" warning: INP: offset \"010\" is octal because of its leading 0: "
     "8\n"},
    {"mbbi with more bits than its type", "mbbi", "INP=@P/0 T=BYTE|NOBT=11",
     "S7plc mbbi \"%s\" warning: NOBT=11 SHFT=0: UINT8 has bits 0 to 7, the others read 0\n"},
    {"mbbiDirect with too many bits", "mbbiDirect", "INP=@P/0|NOBT=17",
     "S7plc mbbiDirect \"%s\" warning: NOBT=17 SHFT=0: INT16 has bits 0 to 15, the others read "
     "0\n"},
    {"mbbi without NOBT", "mbbi", "INP=@P/0",
     "S7plc mbbi \"%s\" warning: NOBT is 0: the record always reads 0. Set NOBT to its number "
     "of bits\n"},
    {"mbbiDirect without NOBT", "mbbiDirect", "INP=@P/0",
     "S7plc mbbiDirect \"%s\" warning: NOBT is 0: the record always reads 0. Set NOBT to its "
     "number of bits\n"},
    {"mbbo without NOBT", "mbbo", "OUT=@P/0",
     "S7plc mbbo \"%s\" warning: NOBT is 0: the record always writes nothing. Set NOBT to its "
     "number of bits\n"},
    {"mbboDirect without NOBT", "mbboDirect", "OUT=@P/0",
     "S7plc mbboDirect \"%s\" warning: NOBT is 0: the record always writes nothing. Set NOBT "
     "to its number of bits\n"},
    {"a string longer than its record", "stringin", "INP=@P/0 L=50",
     "S7plc stringin \"%s\" warning: L=50 is more than the record holds: reduced to 40\n"},
    {"mbbo with texts and no values", "mbbo", "OUT=@P/0|NOBT=2|ZRST=off|ONST=auto|TWST=manual",
     "S7plc mbbo \"%s\" warning: states with a text have no value of their own: the record "
     "writes them as 0, like ZRST. Set ONVL TWVL to the PLC's numbers\n"},
    {"mbbi with a text without a value", "mbbi",
     "INP=@P/0|NOBT=2|ZRST=off|ONST=auto|ONVL=1|FFST=manual",
     "S7plc mbbi \"%s\" warning: states with a text have no value of their own: the record "
     "never shows them; it reads 0 as ZRST. Set FFVL to the PLC's numbers\n"},
    {"limits of a float", "ao", "OUT=@P/0 T=REAL32 L=0 H=100",
     "S7plc ao \"%s\" warning: OUT: L= and H= have no effect on REAL32: it is neither cut nor "
     "scaled by them\n"},
    {"LINEAR of a float", "ai", "INP=@P/8 T=REAL32|LINR=LINEAR|EGUF=100",
     "S7plc ai \"%s\" warning: LINR has no effect on REAL32, which is VAL as it is. Scale it "
     "with ASLO and AOFF\n"},
    {"LINEAR without EGUF", "ao", "OUT=@P/0|LINR=LINEAR",
     "S7plc ao \"%s\" warning: LINR=LINEAR, but EGUL and EGUF are both 0: the record always "
     "writes the same. Set them to what L and H are in EGU\n"},
    {"limits of a longout", "longout", "OUT=@P/0 T=INT8 L=0 H=100",
     "S7plc longout \"%s\" warning: OUT: H= has no effect on longout: a value that does not fit "
     "wraps in INT8; L= and H= are for ai, ao and calcout, L= for texts, B= for bi and bo\n"},
    {"the bit of an ai", "ai", "INP=@P/8 B=3",
     "S7plc ai \"%s\" warning: INP: B= has no effect on ai; L= and H= are for ai, ao and calcout, "
     "L= for texts, B= for bi and bo\n"},
    {"a + that nothing follows", "ai", "INP=@P/4+",
     "S7plc ai \"%s\" warning: INP: nothing follows a +: taken as 0\n"},
    {"nothing about zeros of macros", "longout", "OUT=@P/0 L=0 H=0 B=0", ""},
    {"nothing about a good record", "ai", "INP=@P/8 T=REAL32", ""},
    {"nothing about what macros leave", "ai", "INP=@P/8 T=REAL32 L=0 H=0|EGUF=10", ""},
    {"nothing about good states", "mbbi",
     "INP=@P/0 T=BYTE|NOBT=2|SHFT=6|ONST=on|ONVL=1|TWST=off", ""},
    {"nothing about all bits", "mbbiDirect", "INP=@P/0 T=DWORD|NOBT=32", ""},
    {"nothing about LINEAR", "ao", "OUT=@P/0|LINR=LINEAR|EGUF=10", ""},
};

static const char *nameOf(const char *kind, size_t i)
{
    static char name[40];

    epicsSnprintf(name, sizeof(name), "%s%lu", kind, (unsigned long)i);
    return name;
}

static const char *field(const char *record, const char *name)
{
    static char pv[60];

    epicsSnprintf(pv, sizeof(pv), "%s.%s", record, name);
    return pv;
}

static void testRefused(size_t i, const char *said)
{
    const char *name = nameOf("bad", i);
    char expected[400], title[120];

    epicsSnprintf(expected, sizeof(expected), refused[i].message, name);
    testOk(strstr(said, expected) != NULL, "the message names %s", refused[i].title);
    if (!strstr(said, expected))
        testDiag("not said:\n%s", expected);
    epicsSnprintf(title, sizeof(title), "the record has the reason in AMSG: %s",
                  refused[i].amsg);
    isMessage(name, refused[i].amsg, title);
    isValue(field(name, "SEVR"), "INVALID", "it is INVALID before it ever processes");
    put(field(name, "PROC"), "1");
    isValue(field(name, "STAT"), "LINK", "it can be processed, with a LINK alarm");
    isValue(field(name, "PACT"), "0", "it is not stuck");
    if (!strstr(refused[i].fields, "addr"))
        isValue(field(name, "SCAN"), "I/O Intr", "it keeps SCAN=I/O Intr");
    else
        testSkip(1, "S7plc addr has no I/O Intr");
}

static void testWarned(size_t i, const char *said)
{
    const char *name = nameOf("odd", i);
    char expected[400], quoted[50];
    int ok;

    epicsSnprintf(expected, sizeof(expected), warned[i].message, name);
    epicsSnprintf(quoted, sizeof(quoted), "\"%s\"", name);
    ok = expected[0] ? strstr(said, expected) != NULL : strstr(said, quoted) == NULL;
    testOk(ok, "warns of %s", warned[i].title);
    if (!ok)
        testDiag("not said:\n%s", expected);
    put(field(name, linkField(warned[i].record)[0] == 'I' ? "PROC" : "VAL"), "1");
    isValue(field(name, "STAT"), "COMM", "the record works all the same");
}

static void testMessages(void)
{
    static char said[20000];
    char fields[300];
    size_t i;

    iocBegin();
    makeStation("P", 1, 64, 32);
    makeStation("NoIn", 1, 0, 32);
    for (i = 0; i < COUNT(refused); i++) {
        epicsSnprintf(fields, sizeof(fields), "%s%s", refused[i].fields,
                      strstr(refused[i].fields, "addr") ? "" : "|SCAN=I/O Intr");
        makeRecord(refused[i].record, nameOf("bad", i), fields);
    }
    for (i = 0; i < COUNT(warned); i++)
        makeRecord(warned[i].record, nameOf("odd", i), warned[i].fields);
    iocRunOk();
    strcpy(said, messages());
    for (i = 0; i < COUNT(refused); i++)
        testRefused(i, said);
    for (i = 0; i < COUNT(warned); i++)
        testWarned(i, said);
    testOk(messages()[0] == 0, "nothing more is said when they process");
    iocEnd();
}

/* --- Links that change at run time -------------------------------------------------- */

#define BLOCK 64

/* For each record type two good links; the block has other bytes in these two places. */
static const struct {
    const char *record;
    const char *fields;
    const char *first, *second; /* links, the second without error at init */
    const char *value, *other;  /* VAL of inputs; what outputs put, both times */
    const char *bytes;          /* what outputs wrote at 0, and then at 16 */
} changes[] = {
    {"ai", "", "@P/0", "@P/16", "258", "516", ""},
    {"bi", "", "@P/0 T=BYTE B=0", "@P/0 T=BYTE B=1", "1", "0", ""},
    {"mbbi", "|NOBT=4|SHFT=4", "@P/2 T=BYTE", "@P/18 T=BYTE", "1", "2", ""},
    {"mbbiDirect", "|NOBT=4|SHFT=4", "@P/2 T=BYTE", "@P/18 T=BYTE", "1", "2", ""},
    {"longin", "", "@P/0", "@P/16", "258", "516", ""},
    {"int64in", "", "@P/0", "@P/16", "258", "516", ""},
    {"stringin", "", "@P/4 L=2", "@P/20 L=2", "ab", "xy", ""},
    {"lsi", "|SIZV=50", "@P/4 L=2", "@P/20 L=2", "ab", "xy", ""},
    {"waveform", "|FTVL=SHORT|NELM=2", "@P/0", "@P/16", "258,5139", "516,10279", ""},
    {"aai", "|FTVL=SHORT|NELM=2", "@P/0", "@P/16", "258,5139", "516,10279", ""},
    {"ao", "", "@P/0", "@P/16", "5", "", "0005"},
    {"calcout", "|CALC=A", "@P/0", "@P/16", "5", "", "0005"},
    {"bo", "", "@P/0 T=BYTE B=4", "@P/16 T=BYTE B=4", "1", "", "10"},
    {"mbbo", "|NOBT=4|SHFT=4", "@P/0 T=BYTE", "@P/16 T=BYTE", "1", "", "10"},
    {"mbboDirect", "|NOBT=4|SHFT=4", "@P/0 T=BYTE", "@P/16 T=BYTE", "1", "", "10"},
    {"longout", "", "@P/0", "@P/16", "5", "", "0005"},
    {"int64out", "", "@P/0", "@P/16", "5", "", "0005"},
    {"stringout", "", "@P/0 L=2", "@P/16 L=2", "ab", "", "6162"},
    {"lso", "|SIZV=50", "@P/0 L=2", "@P/16 L=2", "ab", "", "6162"},
    {"aao", "|FTVL=SHORT|NELM=2", "@P/0", "@P/16", "1,2", "", "00010002"},
};

static const char *titleOf(size_t i, const char *what)
{
    static char title[120];

    epicsSnprintf(title, sizeof(title), "%s: %s", changes[i].record, what);
    return title;
}

#define OUTPUTS 10

static int isInput(size_t i)
{
    return strcmp(linkField(changes[i].record), "INP") == 0;
}

static const char *linkOf(size_t i, const char *name)
{
    static char pv[40];

    epicsSnprintf(pv, sizeof(pv), "%s.%s", name, linkField(changes[i].record));
    return pv;
}

/* Processes the record and looks at its value, or at the bytes it writes. */
static void works(plcStation *station, size_t i, const char *name, int second,
                  const char *what)
{
    char pv[40];

    if (isInput(i)) {
        epicsSnprintf(pv, sizeof(pv), "%s.PROC", name);
        put(pv, "1");
        isValue(name, second ? changes[i].other : changes[i].value, titleOf(i, what));
        return;
    }
    setOutput(station, second ? 16 : 0, "00000000");
    epicsSnprintf(pv, sizeof(pv), "%s.%s", name,
                  strcmp(changes[i].record, "calcout") ? "VAL" : "A");
    put(pv, changes[i].value);
    isOutput(station, second ? 16 : 0, changes[i].bytes, titleOf(i, what));
}

/* An output's LINK alarm ends with its link, not with its next put. */
static void linkEnds(size_t i, const char *name, const char *stat)
{
    char pv[40];

    if (isInput(i))
        return;
    epicsSnprintf(pv, sizeof(pv), "%s.STAT", name);
    isValue(pv, stat, titleOf(i, "has no LINK alarm any more"));
}

static void testChange(plcStation *station, size_t i, const char *name)
{
    char pv[40];

    works(station, i, name, 0, "works with its first link");
    testOk(put(linkOf(i, name), changes[i].second) == 0, "%s",
           titleOf(i, "takes another link"));
    works(station, i, name, 1, "works with the other link");
    testOk(put(linkOf(i, name), changes[i].first) == 0, "%s",
           titleOf(i, "takes the first link again"));
    works(station, i, name, 0, "works with the first link again");

    messages();
    testOk(put(linkOf(i, name), "@P/9999") == 0, "%s", titleOf(i, "takes a bad link"));
    epicsSnprintf(pv, sizeof(pv), "%s.SEVR", name);
    isValue(pv, "INVALID", titleOf(i, "is INVALID at once with a bad link"));
    testOk(strstr(messages(), "9999 + ") != NULL, "%s", titleOf(i, "says why"));
    epicsSnprintf(pv, sizeof(pv), "%s.PROC", name);
    put(pv, "1");
    epicsSnprintf(pv, sizeof(pv), "%s.STAT", name);
    isValue(pv, "LINK", titleOf(i, "has a LINK alarm with a bad link"));
    put(linkOf(i, name), changes[i].first);
    linkEnds(i, name, "NO_ALARM");
    works(station, i, name, 0, "works again with a good link");
}

static void testChanges(void)
{
    static epicsUInt8 block[BLOCK];
    plcStation *station;
    char name[40], fields[200];
    size_t i;

    unhex("010214136162", block);
    unhex("020428277879", block + 16);
    iocBegin();
    station = makeStation("P", 1, BLOCK, BLOCK);
    for (i = 0; i < COUNT(changes); i++) {
        epicsSnprintf(fields, sizeof(fields), "%s=%s%s", linkField(changes[i].record),
                      changes[i].first, changes[i].fields);
        epicsSnprintf(name, sizeof(name), "good%lu", (unsigned long)i);
        makeRecord(changes[i].record, name, fields);
        epicsSnprintf(fields, sizeof(fields), "%s=@Nowhere/0%s",
                      linkField(changes[i].record), changes[i].fields);
        epicsSnprintf(name, sizeof(name), "bad%lu", (unsigned long)i);
        makeRecord(changes[i].record, name, fields);
    }
    iocRunOk();
    publish(station, block, 1);
    for (i = 0; i < COUNT(changes); i++) {
        epicsSnprintf(name, sizeof(name), "good%lu", (unsigned long)i);
        testChange(station, i, name);
        epicsSnprintf(name, sizeof(name), "bad%lu", (unsigned long)i);
        put(linkOf(i, name), changes[i].second);
        linkEnds(i, name, "UDF");
        works(station, i, name, 1, "comes to life when its bad link becomes good");
    }
    iocEnd();
}

/* --- More about run time ------------------------------------------------------------ */

static void testScan(void)
{
    epicsUInt8 block[BLOCK] = {1, 2};
    plcStation *station;

    iocBegin();
    station = makeStation("P", 1, BLOCK, BLOCK);
    makeRecord("ai", "R", "INP=@P/0|SCAN=I/O Intr");
    makeRecord("ai", "Linear", "INP=@P/0 L=0 H=258|LINR=LINEAR|EGUL=0|EGUF=1");
    makeRecord("bi", "Stat", "INP=@P|DTYP=S7plc stat");
    makeRecord("stringout", "Addr", "OUT=@P|DTYP=S7plc addr");
    iocRunOk();
    publish(station, block, 1);
    messages();
    put("R.INP", "@P/9999");
    isValue("R.SCAN", "I/O Intr", "a bad link does not change SCAN");
    put("R.INP", "@P/1");
    isValue("R.SCAN", "I/O Intr", "a good link does not change SCAN");
    put("Linear.PROC", "1");
    isValue("Linear", "1", "ai LINEAR maps with the limits of its link");
    put("Linear.INP", "@P/0 L=0 H=516");
    put("Linear.PROC", "1");
    isValue("Linear", "0.5", "ai LINEAR maps with the limits of its new link");

    testOk(put("Stat.INP", "@Q") == 0, "S7plc stat takes a bad link");
    isMessage("Stat", "no PLC \"Q\"", "S7plc stat has the reason in AMSG");
    put("Stat.INP", "@P");
    put("Stat.PROC", "1");
    isValue("Stat.SEVR", "NO_ALARM", "S7plc stat works again with a good link");
    testOk(put("Addr.OUT", "@Q") == 0, "S7plc addr takes a bad link");
    isMessage("Addr", "no PLC \"Q\"", "S7plc addr has the reason in AMSG");
    testOk(put("Addr", "localhost") != 0, "S7plc addr refuses values with a bad link");
    iocEnd();
}

/* --- Nonsense ----------------------------------------------------------------------- */

#define NONSENSE 2000

/* The same numbers on every machine. */
static unsigned dice(unsigned sides)
{
    static epicsUInt32 seed = 1;

    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % sides;
}

/* A link of pieces that links are made of, in any order. */
static void nonsense(char *text, size_t size)
{
    static const char *const pieces[] = {
        "@", "P", "/", "0", "12", "65536", "-", "+", " ", "'", "T=", "L=", "H=", "B=",
        "R=", "INT16", "STRING", "FLOAT", "TIME", "QWORD", "0x", "99999999999999999999",
        "=", "\t", "\xff", "%s%n", "W=", "W=high", "/4 T=INT8", "@P/", "1e9", ";",
    };
    unsigned n = dice(12);

    strcpy(text, dice(4) ? "@P/" : "@");
    while (n-- && strlen(text) + 25 < size)
        strcat(text, pieces[dice(COUNT(pieces))]);
}

static void testNonsense(void)
{
    static const char *const types[] = {"ai",  "bo",       "stringin",
                                        "lso", "waveform", "mbbo"};
    epicsUInt8 block[BLOCK] = {1, 2};
    unsigned i, good = 0, bad = 0;
    plcStation *station;
    char text[200], pv[40];
    size_t t;

    iocBegin();
    station = makeStation("P", 1, BLOCK, BLOCK);
    for (t = 0; t < COUNT(types); t++)
        makeRecord(types[t], types[t], strcmp(types[t], "waveform") ? "" :
                   "FTVL=CHAR|NELM=20");
    iocRunOk();
    publish(station, block, 1);
    for (i = 0; i < NONSENSE; i++) {
        t = i % COUNT(types);
        nonsense(text, sizeof(text));
        epicsSnprintf(pv, sizeof(pv), "%s.%s", types[t], linkField(types[t]));
        put(pv, text);
        put(field(types[t], "PROC"), "1");
        if (strcmp(get(field(types[t], "STAT")), "LINK") == 0)
            bad++;
        else
            good++;
    }
    testOk(bad > NONSENSE / 2 && good > 0, "%u nonsense links refused, %u others work",
           bad, good);
    put("ai.INP", "@P/0");
    put("ai.PROC", "1");
    isValue("ai", "258", "after them a good link works");
    iocEnd();
}

MAIN(recordTestLinks)
{
    testPlan(
        (int)(6 * COUNT(refused) + 2 * COUNT(warned) + 1 + 11 * COUNT(changes) + 2 * OUTPUTS + 12));
    testMessages();
    testChanges();
    testScan();
    testNonsense();
    return testDone();
}

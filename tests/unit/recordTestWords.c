/* The order of words in records: W= against the option wordOrder, scales, bits, arrays,
 * read-backs, what s7plcShow says, the C functions; and where W= means nothing. The bytes of
 * every type on every record are in recordTestTypes.c.
 */
#include <stdio.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "drvS7plc.h"
#include "plcShow.h"
#include "recordTest.h"

#define BLOCK 64

/* The PLC keeps its low word first; M does not say so, L does. */
static plcStation *stationL, *stationM;

static void makeStations(void)
{
    char error[200];

    stationL = makeStation("L", 1, BLOCK, BLOCK);
    stationM = makeStation("M", 1, BLOCK, BLOCK);
    if (plcStationSetOption(stationL, "wordOrder", "low", error, sizeof(error)))
        testAbort("%s", error);
}

static const char *field(const char *record, const char *name)
{
    static char pv[60];

    epicsSnprintf(pv, sizeof(pv), "%s.%s", record, name);
    return pv;
}

/* --- Inputs: the block is the same for both PLCs ------------------------------------- */

static const char inBlock[] =
    "03048102"         /*  0: 0x81020304 */
    "0000c049"         /*  4: -3.140625 */
    "0708050603048102" /*  8: 0x8102030405060708 */
    "0000000100010000" /* 16: 0x10000, 1 as 32-bit values with the low word first */
    "0000c04900004049" /* 24: -3.140625, 3.140625 */
    "12340000"         /* 32 */
    "00000001";        /* 36: bit 16 */

static const struct {
    const char *title, *type, *fields, *value;
} inputs[] = {
    {"the option holds where the link is silent", "longin", "INP=@L/0 T=INT32",
     "-2130574588"},
    {"W=low says the same", "longin", "INP=@L/0 T=INT32 W=low", "-2130574588"},
    {"W=high wins", "longin", "INP=@L/0 T=INT32 W=high", "50626818"},
    {"without option high is the default", "longin", "INP=@M/0 T=INT32", "50626818"},
    {"W=high says the same", "longin", "INP=@M/0 T=INT32 W=high", "50626818"},
    {"W=low wins", "longin", "INP=@M/0 T=INT32 W=low", "-2130574588"},
    {"in small letters", "longin", "INP=@M/0 t=int32 w=LOW", "-2130574588"},
    {"in quotes, without blanks", "longin", "INP=@M/0'T=INT32W=lowB=3'", "-2130574588"},
    {"a float", "ai", "INP=@M/4 T=FLOAT W=low", "-3.140625"},
    {"64 bits", "int64in", "INP=@M/8 T=INT64 W=low", "-9150748177064392952"},
    {"an odd offset", "int64in", "INP=@M/33 T=UINT32 W=low", "13312"},
    {"a scale", "ai", "INP=@M/16 T=UINT32 W=low L=0 H=131072|LINR=LINEAR|EGUF=10", "5"},
    {"bit 16", "bi", "INP=@M/16 T=DWORD W=low B=16", "1"},
    {"bit 0", "bi", "INP=@M/16 T=DWORD W=low B=0", "0"},
    {"bit 0 of the next", "bi", "INP=@M/20 T=DWORD W=low B=0", "1"},
    {"bit 63", "bi", "INP=@M/8 T=QWORD W=low B=63", "1"},
    {"bit 62", "bi", "INP=@M/8 T=QWORD W=low B=62", "0"},
    {"bits", "mbbi", "INP=@L/0 T=DWORD|NOBT=4|SHFT=16", "2"},
    {"bits of another order", "mbbi", "INP=@L/0 T=DWORD W=high|NOBT=4|SHFT=16", "4"},
    {"bits directly", "mbbiDirect", "INP=@M/0 T=DWORD W=low|NOBT=8|SHFT=8", "3"},
    {"an array", "waveform", "INP=@L/16 T=INT32|FTVL=LONG|NELM=2", "65536,1"},
    {"an array of floats", "aai", "INP=@M/24 T=FLOAT W=low|FTVL=FLOAT|NELM=2",
     "-3.140625,3.140625"},
    {"2 bytes are as ever", "longin", "INP=@L/32", "4660"},
};

static void testInputs(void)
{
    char title[100];
    size_t i;

    for (i = 0; i < COUNT(inputs); i++) {
        epicsSnprintf(title, sizeof(title), "in%lu", (unsigned long)i);
        put(field(title, "PROC"), "1");
        isValue(field(title, "VAL"), inputs[i].value, inputs[i].title);
    }
}

/* --- Outputs ------------------------------------------------------------------------- */

static const struct {
    const char *title, *type, *fields;
    const char *value;
    size_t offset;
    const char *before, *bytes; /* of the output block */
} outputs[] = {
    {"longout by the option", "longout", "OUT=@L/0 T=INT32", "305419896", 0, "00000000",
     "56781234"},
    {"longout with W=high", "longout", "OUT=@L/0 T=INT32 W=high", "305419896", 0, "00000000",
     "12345678"},
    {"longout with W=low", "longout", "OUT=@M/0 T=INT32 W=low", "305419896", 0, "00000000",
     "56781234"},
    {"int64out", "int64out", "OUT=@L/0 T=INT64", "72623859790382856", 0, "0000000000000000",
     "0708050603040102"},
    {"ao with a float", "ao", "OUT=@L/0 T=FLOAT", "-3.140625", 0, "00000000", "0000c049"},
    {"ao with 64 bits", "ao", "OUT=@L/0 T=DOUBLE", "-3.140625", 0, "0000000000000000",
     "000000002000c009"},
    {"ao with a scale", "ao", "OUT=@L/0 T=UINT32 L=0 H=131072|LINR=LINEAR|EGUF=10", "5", 0,
     "00000000", "00000001"},
    {"ao with a limit", "ao", "OUT=@L/0 T=UINT32 L=0 H=65536", "99999", 0, "00000000",
     "00000001"},
    {"calcout", "calcout", "OUT=@M/0 T=FLOAT W=low|CALC=A", "-3.140625", 0, "00000000",
     "0000c049"},
    {"bo sets bit 16", "bo", "OUT=@L/0 T=DWORD B=16", "1", 0, "f0f0f0f0", "f0f0f0f1"},
    {"bo clears bit 4", "bo", "OUT=@L/0 T=DWORD B=4", "0", 0, "f0f0f0f0", "f0e0f0f0"},
    {"bo sets bit 40 of 64", "bo", "OUT=@M/0 T=QWORD W=low B=40", "1", 0,
     "0000000000000000", "0000000001000000"},
    {"mbbo", "mbbo", "OUT=@L/0 T=DWORD|NOBT=4|SHFT=20", "5", 0, "ffffffff", "ffffff5f"},
    {"mbboDirect", "mbboDirect", "OUT=@M/0 T=DWORD W=low|NOBT=8|SHFT=8", "3", 0, "ffffffff",
     "03ffffff"},
    {"aao", "aao", "OUT=@L/0|FTVL=LONG|NELM=2", "65536,1", 0, "ffffffffffffffff",
     "0000000100010000"},
    {"aao with W=high", "aao", "OUT=@L/0 W=high|FTVL=FLOAT|NELM=2", "-3.140625,3.140625", 0,
     "0000000000000000", "c049000040490000"},
    {"a text as ever", "stringout", "OUT=@L/0 L=4", "abcd", 0, "00000000", "61626364"},
    {"2 bytes as ever", "longout", "OUT=@L/0", "4660", 0, "00000000", "12340000"},
};

static void testOutputs(void)
{
    char name[40];
    size_t i;

    for (i = 0; i < COUNT(outputs); i++) {
        plcStation *station = strstr(outputs[i].fields, "@L") ? stationL : stationM;

        epicsSnprintf(name, sizeof(name), "out%lu", (unsigned long)i);
        setOutput(station, outputs[i].offset, outputs[i].before);
        put(field(name, strcmp(outputs[i].type, "calcout") ? "VAL" : "A"),
            outputs[i].value);
        isOutput(station, outputs[i].offset, outputs[i].bytes, outputs[i].title);
    }
}

/* --- Links --------------------------------------------------------------------------- */

static const struct {
    const char *type, *fields;
    const char *message; /* "": none */
} links[] = {
    {"longin", "INP=@L/0 W=low",
     "S7plc longin \"link0\" warning: INP: W= has no effect on INT16: only types of 4 and 8 "
     "bytes have an order of words; allowed: W=BADC DCBA, the lower byte first\n"},
    {"bi", "INP=@L/0 T=BYTE W=high B=1",
     "S7plc bi \"link1\" warning: INP: W= has no effect on UINT8: only types of 4 and 8 bytes "
     "have an order of words\n"},
    {"stringout", "OUT=@L/40 L=8 W=high",
     "S7plc stringout \"link2\" warning: OUT: W=high and W=low have no effect on STRING: the order "
     "of a text is W=ABCD CDAB BADC DCBA A0 0A\n"},
    {"waveform", "INP=@L/0 T=TIME W=low|FTVL=UCHAR|NELM=8",
     "S7plc waveform \"link3\" warning: INP: W= has no effect on TIME: only types of 4 and 8 "
     "bytes have an order of words\n"},
    {"aao", "OUT=@L/0 W=low|FTVL=SHORT|NELM=8",
     "S7plc aao \"link4\" warning: OUT: W= has no effect on INT16: only types of 4 and 8 bytes "
     "have an order of words; allowed: W=BADC DCBA, the lower byte first\n"},
    {"ai", "INP=@L/0 T=INT32 W=LSW",
     "S7plc ai \"link5\" INP: W=LSW is no word order; allowed: W=high low ABCD CDAB BADC DCBA, for "
     "texts ABCD CDAB BADC DCBA A0 0A\n"
     "    @L/0 T=INT32 W=LSW\n"
     "                   ^\n"},
    {"ai", "INP=@L/0 T=INT32 W=",
     "S7plc ai \"link6\" INP: W= has no value; allowed: W=high low ABCD CDAB BADC DCBA, for "
     "texts ABCD CDAB BADC DCBA A0 0A\n"
     "    @L/0 T=INT32 W=\n"
     "                   ^\n"},
    {"ai", "INP=@L/0 T=FLOAT W=high W=low",
     "S7plc ai \"link7\" warning: INP: W= is given twice: the last one counts\n"},
    {"ai", "INP=@L/0 T=INT32 W=low", ""},
    {"bi", "INP=@L/0 W=low|DTYP=S7plc stat", ""},
};

static void testLinks(const char *said)
{
    char name[40];
    size_t i;

    for (i = 0; i < COUNT(links); i++) {
        epicsSnprintf(name, sizeof(name), "\"link%lu\"", (unsigned long)i);
        if (!testOk(links[i].message[0] ? strstr(said, links[i].message) != NULL
                                        : strstr(said, name) == NULL,
                    "%s %s: %.*s", links[i].type, links[i].fields,
                    (int)strcspn(links[i].message, "\n"), links[i].message))
            testDiag("said: %s", said);
    }
    put("link5.INP", "@L/0 T=INT32");
    put("link5.PROC", "1");
    isValue("link5", "-2130574588", "a good link brings it to life, in the PLC's order");
    put("link5.INP", "@L/0 T=INT32 W=high");
    put("link5.PROC", "1");
    isValue("link5", "50626818", "another one changes the order");
    put("link5.INP", "@L/32 T=INT16 W=high");
    put("link5.PROC", "1");
    isValue("link5", "4660", "a short type has none");
}

/* --- People and C -------------------------------------------------------------------- */

static void testShow(void)
{
    static const char *const lines[] = {
        "        0-3         show:int (longin INT32 W=low) = -2130574588\n",
        "        0-3         show:high (longin INT32) = 50626818\n",
        "        4-7         show:real (ai REAL32 W=low) = -3.140625\n",
        "        36-39       show:bit (bi UINT32 bit 16 W=low) = 1\n",
        "        show:same at 36-39 and show:bit at 36-39\n",
    };
    char text[20000] = "";
    FILE *file = fmemopen(text, sizeof(text), "w");
    size_t i;

    plcShow(stationL, "in", file);
    fclose(file);
    for (i = 0; i < COUNT(lines); i++)
        testOk(strstr(text, lines[i]) != NULL, "s7plcShow: %.*s", (int)strcspn(lines[i], "\n"),
               lines[i]);
    testOk(strstr(text, "show:other at") == NULL && strstr(text, "and show:other") == NULL,
           "another bit in another order is no overlap");
    file = fmemopen(text, sizeof(text), "w");
    plcStationReport(stationL, file, 1);
    fclose(file);
    testOk(strstr(text, "big endian, low word first\n") && strstr(text, "wordOrder=low"),
           "the report tells the order: %.*s", (int)strcspn(text, "\n"), text);
}

static void testC(void)
{
    epicsInt32 values[2] = {0x10000, 1}, got[2] = {0};
    epicsUInt32 mask = 0xFFFF0000u;
    epicsInt64 wide = 0x0102030405060708LL;
    char name[] = "L";

    testOk(s7plcReadArray(stationL, 16, 4, 2, got) == S7PLC_OK && got[0] == 0x10000 &&
               got[1] == 1,
           "s7plcReadArray reads in the order of the PLC");
    testOk(s7plcOpen(name) == stationL, "s7plcOpen finds the PLC");
    s7plcWriteArray(stationL, 0, 4, 2, values);
    isOutput(stationL, 0, "0000000100010000", "s7plcWriteArray writes in it");
    setOutput(stationL, 0, "ffffffff");
    s7plcWriteMasked(stationL, 0, 4, &values[0], &mask);
    isOutput(stationL, 0, "ffff0001", "s7plcWriteMasked knows the bits");
    setOutput(stationL, 0, "ffffffffffffffff");
    s7plcWriteMaskedArray(stationL, 0, 4, 2, values, &mask);
    isOutput(stationL, 0, "ffff0001ffff0000", "s7plcWriteMaskedArray in each element");
    s7plcWrite(stationL, 0, 8, &wide);
    isOutput(stationL, 0, "0708050603040102", "8 bytes");
    s7plcWrite(stationM, 0, 8, &wide);
    isOutput(stationM, 0, "0102030405060708", "8 bytes without the option");
}

MAIN(recordTestWords)
{
    epicsUInt8 block[BLOCK] = {0};
    static char said[20000];
    char name[40], error[200];
    size_t i;

    testPlan((int)(COUNT(inputs) + COUNT(outputs) + COUNT(links) + 3 + 7 + 7 + 1));
    iocBegin();
    makeStations();
    for (i = 0; i < COUNT(inputs); i++) {
        epicsSnprintf(name, sizeof(name), "in%lu", (unsigned long)i);
        makeRecord(inputs[i].type, name, inputs[i].fields);
    }
    for (i = 0; i < COUNT(outputs); i++) {
        epicsSnprintf(name, sizeof(name), "out%lu", (unsigned long)i);
        makeRecord(outputs[i].type, name, outputs[i].fields);
    }
    for (i = 0; i < COUNT(links); i++) {
        epicsSnprintf(name, sizeof(name), "link%lu", (unsigned long)i);
        makeRecord(links[i].type, name, links[i].fields);
    }
    makeRecord("longin", "show:int", "INP=@L/0 T=INT32");
    makeRecord("longin", "show:high", "INP=@L/0 T=INT32 W=high");
    makeRecord("ai", "show:real", "INP=@L/4 T=FLOAT");
    makeRecord("bi", "show:bit", "INP=@L/36 T=DWORD B=16");
    makeRecord("bi", "show:same", "INP=@L/36 T=DWORD B=0 W=high");
    makeRecord("bi", "show:other", "INP=@L/36 T=DWORD B=16 W=high");
    iocRunOk();
    strcpy(said, messages());
    unhex(inBlock, block);
    publish(stationL, block, 1);
    publish(stationM, block, 1);
    testInputs();
    testOutputs();
    testLinks(said);
    testShow();
    testC();
    testOk(plcStationSetOption(stationL, "wordOrder", "high", error, sizeof(error)) == -1,
           "it is too late for the option: %s", error);
    iocEnd();
    return testDone();
}

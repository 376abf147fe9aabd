/* The order of the characters of texts in records: W= against the option textOrder, on each record
 * type that has texts; read-backs, what s7plcShow says, what is refused. The bytes of each order
 * are in codecTest.c.
 */
#include <stdio.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcShow.h"
#include "recordTest.h"

#define BLOCK 400

/* The PLC has the first character of its texts in the lower half, says S; N does not say so; L has
 * the least significant byte of numbers first, which is nothing to texts. */
static plcStation *stationS, *stationN, *stationL;

static void makeStations(void)
{
    char error[200];

    stationS = makeStation("S", 1, BLOCK, BLOCK);
    stationN = makeStation("N", 1, BLOCK, BLOCK);
    stationL = makeStation("L", 0, BLOCK, BLOCK);
    if (plcStationSetOption(stationS, "textOrder", "badc", error, sizeof(error)) ||
        plcStationSetOption(stationN, "wordOrder", "DCBA", error, sizeof(error)))
        testAbort("%s", error);
}

static const char *field(const char *record, const char *name)
{
    static char pv[60];

    epicsSnprintf(pv, sizeof(pv), "%s.%s", record, name);
    return pv;
}

/* --- Inputs: the same block for all --------------------------------------------------- */

static const char inBlock[] = "4142434445464748" /*  0: ABCDEFGH */
                              "0041004200430000" /*  8: ABC, one in two bytes */
                              "0408424144430048" /* 16: in BADC an S7STRING of 8 with 4, ABCD */
                              "4142430000000000" /* 24: ABC */
                              "4120414220430000";

static const struct {
    const char *title, *type, *fields, *value;
} inputs[] = {
    {"the option holds where the link is silent", "stringin", "INP=@S/0 L=8", "BADCFEHG"},
    {"W=ABCD wins", "stringin", "INP=@S/0 L=8 W=ABCD", "ABCDEFGH"},
    {"without option ABCD is the default", "stringin", "INP=@N/0 L=8", "ABCDEFGH"},
    {"also where the numbers have the least significant byte first", "stringin", "INP=@L/0 L=8",
     "ABCDEFGH"},
    {"W=BADC", "stringin", "INP=@N/0 L=8 W=BADC", "BADCFEHG"},
    {"W=CDAB", "stringin", "INP=@L/0 L=8 W=CDAB", "CDABGHEF"},
    {"W=DCBA, in small letters", "stringin", "INP=@N/0 L=8 w=dcba", "DCBAHGFE"},
    {"W=0A", "stringin", "INP=@N/8 L=8 W=0A", "ABC"},
    {"W=A0", "stringin", "INP=@N/9 L=8 W=A0", "ABC"},
    {"as long as the record holds: 40 characters of 80 bytes", "stringin", "INP=@N/8 W=0A", "ABC"},
    {"a text that ends within a word", "stringin", "INP=@S/24 L=8", "BA"},
    {"W=low is nothing to a text", "stringin", "INP=@N/0 L=8 W=low", "ABCDEFGH"},
    {"an S7STRING, its head too", "stringin", "INP=@S/16 T=S7STRING L=6", "ABCD"},
    {"lsi", "lsi", "INP=@S/0 L=8|SIZV=60", "BADCFEHG"},
    {"lsi whose room is odd", "lsi", "INP=@S/0|SIZV=17", "BADCFEHGA"},
    {"lsi of one character in two bytes", "lsi", "INP=@L/8 W=0A|SIZV=60", "ABC"},
    {"waveform", "waveform", "INP=@S/0 T=STRING|FTVL=CHAR|NELM=4", "66,65,68,67"},
    {"waveform with a NUL within", "waveform", "INP=@S/24 T=STRING|FTVL=UCHAR|NELM=4",
     "66,65,0,67"},
    {"waveform of bytes, which are no text", "waveform", "INP=@S/0|FTVL=UCHAR|NELM=4",
     "65,66,67,68"},
    {"waveform of one character in two bytes", "waveform",
     "INP=@N/8 T=STRING W=0A|FTVL=CHAR|NELM=3", "65,66,67"},
    {"aai", "aai", "INP=@N/0 T=STRING W=DCBA|FTVL=CHAR|NELM=8", "68,67,66,65,72,71,70,69"},
    {"aai of an S7STRING", "aai", "INP=@S/16 T=S7STRING L=6|FTVL=CHAR|NELM=6", "65,66,67,68"},
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
    const char *title, *type, *fields, *value, *bytes;
} outputs[] = {
    {"stringout by the option", "stringout", "OUT=@S/0 L=6", "ABCDE", "42414443004523"},
    {"stringout with W=ABCD", "stringout", "OUT=@S/0 L=6 W=ABCD", "ABCDE", "41424344450023"},
    {"stringout with W=CDAB", "stringout", "OUT=@N/0 L=8 W=CDAB", "ABCDE", "434441420000450023"},
    {"stringout with W=DCBA", "stringout", "OUT=@N/0 L=8 W=DCBA", "ABCDE", "444342410000004523"},
    {"stringout with W=A0", "stringout", "OUT=@N/0 L=6 W=A0", "ABCD", "41004200430023"},
    {"stringout with W=0A", "stringout", "OUT=@N/0 L=6 W=0A", "AB", "00410042000023"},
    {"stringout, cut off", "stringout", "OUT=@S/0 L=4", "ABCDE", "4241444323"},
    {"stringout as an S7STRING", "stringout", "OUT=@S/0 T=S7STRING L=4", "AB", "02044241000023"},
    {"lso", "lso", "OUT=@S/0 L=6|SIZV=60", "ABCDE", "42414443004523"},
    {"lso whose room is odd", "lso", "OUT=@S/0|SIZV=17", "ABCDEFGHIJKLMNOPQ",
     "4241444346454847" "4a494c4b4e4d504f23"},
    {"lso of one character in two bytes", "lso", "OUT=@S/0 L=8 W=0A|SIZV=60", "ABC",
     "004100420043000023"},
    {"aao", "aao", "OUT=@S/0 T=STRING|FTVL=CHAR|NELM=4", "65,66,67,68", "4241444323"},
    {"aao of one character in two bytes", "aao", "OUT=@S/0 T=STRING W=A0|FTVL=CHAR|NELM=2", "65,66",
     "4100420023"},
    {"aao of an S7STRING", "aao", "OUT=@S/0 T=S7STRING L=4|FTVL=CHAR|NELM=4", "65,66",
     "02044241000023"},
};

static void testOutputs(void)
{
    char name[40];
    size_t i;

    for (i = 0; i < COUNT(outputs); i++) {
        plcStation *station = strstr(outputs[i].fields, "@S") ? stationS : stationN;

        epicsSnprintf(name, sizeof(name), "out%lu", (unsigned long)i);
        setOutput(station, 0, "2323232323232323232323232323232323232323");
        put(field(name, "VAL"), outputs[i].value);
        isOutput(station, 0, outputs[i].bytes, outputs[i].title);
    }
}

/* --- Read-back, links, people -------------------------------------------------------- */

static const struct {
    const char *type, *fields;
    const char *message; /* "": none */
} links[] = {
    {"stringin", "INP=@S/0 L=5",
     "S7plc stringin \"link0\" INP: L=5: in this order a text has a multiple of 2 bytes; allowed: "
     "such as L=6\n    @S/0 L=5\n         ^\n"},
    {"lsi", "INP=@N/0 L=6 W=CDAB|SIZV=60",
     "S7plc lsi \"link1\" INP: L=6: in this order a text has a multiple of 4 bytes; allowed: such "
     "as L=8\n"},
    {"stringout", "OUT=@N/40 L=8 W=low",
     "S7plc stringout \"link2\" warning: OUT: W=high and W=low have no effect on STRING: the order "
     "of a text is W=ABCD CDAB BADC DCBA A0 0A\n"},
    {"ai", "INP=@N/0 T=INT32 W=A0",
     "S7plc ai \"link3\" INP: W=A0 and W=0A are for texts, not INT32; allowed: W=high low ABCD CDAB "
     "BADC DCBA\n"},
    {"lsi", "INP=@S/0 L=90|SIZV=61",
     "S7plc lsi \"link4\" warning: L=90 is more than the record holds: reduced to 60\n"},
    {"stringin", "INP=@N/0 W=DCBA", ""},
    {"stringin", "INP=@N/0 L=80 W=A0", ""},
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
    put("link0.INP", "@S/0 L=6");
    put("link0.PROC", "1");
    isValue("link0", "BADCFE", "a good link brings it to life, in the PLC's order");
    put("link0.INP", "@S/0 L=8 W=CDAB");
    put("link0.PROC", "1");
    isValue("link0", "CDABGHEF", "another one changes the order");
}

static void testShow(void)
{
    static const char *const lines[] = {
        "(stringin STRING W=BADC) = \"BADCFEHG\"\n",
        "(stringin STRING W=CDAB) = \"CDABGHEF\"\n",
        "(stringin S7STRING W=BADC) = \"ABCD\"\n",
        "(stringin STRING) = \"ABCDEFGH\"\n",
    };
    char text[30000] = "";
    FILE *file = fmemopen(text, sizeof(text), "w");
    size_t i;

    plcShow(stationS, "in", file);
    fclose(file);
    for (i = 0; i < COUNT(lines); i++)
        testOk(strstr(text, lines[i]) != NULL, "s7plcShow: %.*s", (int)strcspn(lines[i], "\n"),
               lines[i]);
}

MAIN(recordTestTexts)
{
    epicsUInt8 block[BLOCK] = {0};
    static char said[20000];
    char name[40], error[200];
    size_t i;

    testPlan((int)(COUNT(inputs) + COUNT(outputs) + COUNT(links) + 2 + 4 + 1));
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
    iocRunOk();
    strcpy(said, messages());
    unhex(inBlock, block);
    publish(stationS, block, 1);
    publish(stationN, block, 1);
    publish(stationL, block, 1);
    testInputs();
    testOutputs();
    testLinks(said);
    testShow();
    testOk(plcStationSetOption(stationS, "textOrder", "ABCD", error, sizeof(error)) == -1,
           "it is too late for the option: %s", error);
    iocEnd();
    return testDone();
}

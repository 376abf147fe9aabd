/* The file of a table of pointers: text to bytes, and what is wrong with it in one line.
 */
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "pointersText.h"

static void goodFiles(void)
{
    static const epicsUInt8 bytes[] = {
        0x12, 0x01, 0, 2, 0,    1,    0x60, 0x37, 0x63, 0x4d, /* CRC: zlib's */
        0x10, 2,    0, 8, 0,    10,   0x84, 0,    0,    0,    0x10, 2,    0, 8, 0,
        1,    0x84, 0, 0, 0x80, 0x10, 2,    0,    2,    0,    0,    0x83, 0, 3, 0x20,
        0x10, 2,    0, 2, 0,    1,    0x84, 0,    0,    0xc0, 0x10, 2,    0, 8, 0,
        2,    0x84, 0, 0, 0x20, 0x10, 2,    0,    8,    0,    10,   0x84, 0, 0, 0};
    char error[300];
    plcPointers *t = read(goodFile, error, sizeof(error));

    testOk(t && t->size == sizeof(bytes) && memcmp(t->bytes, bytes, 6) == 0 &&
               memcmp(t->bytes + 10, bytes + 10, sizeof(bytes) - 10) == 0,
           "a file becomes the bytes of a table, TX rows first %s", error);
    if (!t)
        testAbort("no table");
    testOk(memcmp(t->bytes, bytes, sizeof(bytes)) == 0, "its CRC is that of zlib");
    testOk(plcPointersLayout(t) == 0x1201 && t->rowsTx == 2 && t->rowsRx == 1,
           "layout id and rows");
    testOk(strcmp(plcPointersRowName(t, 0), "Temp Speed") == 0 &&
               strcmp(plcPointersRowName(t, 1), "") == 0 &&
               strcmp(plcPointersRowName(t, 2), "Temp Speed") == 0 &&
               strcmp(plcPointersRowName(t, 3), "") == 0 &&
               strcmp(plcPointersRowName(t, -1), "") == 0,
           "rows have the names that stand behind them");
    plcPointersFree(t);
    t = read("ie_tx 7\nie_rx 8\ntx P#DB1.DBX0.0 BYTE 1 -> 16\n"
             "rx 4 -> P#DB1.DBX0.0 BYTE 1\n",
             error, sizeof(error));
    testOk(t && t->bytes[25] == 7 && t->bytes[35] == 8,
           "other numbers of IE_TX and IE_RX");
    plcPointersFree(t);
}

/* plcmap puts all symbols of a row behind it. */
static void longLine(void)
{
    char text[3000] = "tx P#DB10.DBX0.0 BYTE 8 -> 16", error[300];
    plcPointers *t;
    int i;

    for (i = 0; i < 200; i++)
        strcat(text, " Tank.Setp");
    strcat(text, "\ntx P#DB10.DBX8.0 BYTE 8 -> 24 Last");
    t = read(text, error, sizeof(error));
    testOk(t && t->rowsTx == 2 &&
               strncmp(plcPointersRowName(t, 0), "Tank.Setp Tank", 14) == 0 &&
               strcmp(plcPointersRowName(t, 1), "Last") == 0,
           "a row with 200 names, and one without an end of line %s", error);
    plcPointersFree(t);
}

static void badFiles(void)
{
    static const struct {
        const char *text, *error;
    } files[] = {
        {"",                                       "there is no row"                           },
        {"layout 5\n",                             "there is no row"                           },
        {"layout 70000\n",                         "line 1: \"70000\"; allowed: 0 to 65535"    },
        {"layout\n",                               "line 1: \"\"; allowed: 0 to 65535"         },
        {"\nrows 5\n",                             "line 2: \"rows\"; allowed: layout, ie_tx, ie_rx, crc, tx, rx"},
        {"tx P#DB10.DBX0.0 BYTE 8\n",
         "line 1: \"tx\"; allowed: tx P#DB10.DBX0.0 BYTE 8 -> <byte>"},
        {"rx P#DB10.DBX0.0 BYTE 8 -> 4 x\n",       "line 1: \"rx\"; allowed: rx <byte> -> P#DB10.DBX0.0 BYTE 8"},
        {"tx DB10.DBX0.0 BYTE 8 -> 16\n",
         "line 1: \"DB10.DBX0.0\"; allowed: P#DB10.DBX4.0 or P#M4.0"},
        {"tx P#DB0.DBX0.0 BYTE 8 -> 16\n",         "line 1: \"P#DB0.DBX0.0\"; allowed: P#DB10.DBX4.0 or P#M4.0"},
        {"tx P#DB70000.DBX0.0 BYTE 8 -> 16\n",     "line 1: \"P#DB70000.DBX0.0\"; allowed: a byte of 0 to 32767, and bit 0"},
        {"tx P#DB10.DBX0.1 BYTE 8 -> 16\n",        "line 1: \"P#DB10.DBX0.1\"; allowed: a byte of 0 to 32767, and bit 0"},
        {"tx P#DB10.DBX40000.0 BYTE 8 -> 16\n",    "line 1: \"P#DB10.DBX40000.0\"; allowed: a byte of 0 to 32767, and bit 0"},
        {"tx P#DB10.DBX0.0x BYTE 8 -> 16\n",       "line 1: \"P#DB10.DBX0.0x\"; allowed: P#DB10.DBX4.0 or P#M4.0"},
        {"tx P#Q0.0 BYTE 8 -> 16\n",
         "line 1: \"P#Q0.0\"; allowed: P#DB10.DBX4.0 or P#M4.0"                                },
        {"tx P#DB10.DBX0.0 WORD 8 -> 16\n",        "line 1: \"WORD\"; allowed: BYTE"           },
        {"tx P#DB10.DBX0.0 BYTE 0 -> 16\n",        "line 1: \"0\"; allowed: 1 to 1024 bytes"   },
        {"tx P#DB10.DBX0.0 BYTE 2000 -> 16\n",     "line 1: \"2000\"; allowed: 1 to 1024 bytes"},
        {"tx P#DB10.DBX0.0 BYTE 8 -> x\n",         "line 1: \"x\"; allowed: 0 to 32767"        },
        {"crc 1\ntx P#DB10.DBX0.0 BYTE 8 -> 16\n", "the file says crc 0x00000001, its rows have 0x696EB6A4"},
        {"crc 0xFFFFFFFF\ntx P#DB10.DBX0.0 BYTE 8 -> 16\n",
         "the file says crc 0xFFFFFFFF, its rows have 0x696EB6A4"},
    };
    char error[300];
    size_t i;

    for (i = 0; i < sizeof(files) / sizeof(files[0]); i++) {
        plcPointers *t = read(files[i].text, error, sizeof(error));

        testOk(!t && strcmp(error, files[i].error) == 0,
               "refused: %s", error);
    }
}

/* As many rows as there may be, and one more. */
static void manyRows(void)
{
    char text[256 * 40] = "", error[300];
    plcPointers *t;
    int i;

    for (i = 0; i < 255; i++)
        sprintf(text + strlen(text), "tx P#DB10.DBX%d.0 BYTE 1 -> %d\n", i, 16 + i);
    t = read(text, error, sizeof(error));
    testOk(t && t->rowsTx == 255 && t->size == 10 + 20 * 255, "255 rows are a table %s", error);
    plcPointersFree(t);
    strcat(text, "tx P#M0.0 BYTE 1 -> 300\n");
    t = read(text, error, sizeof(error));
    testOk(!t && strcmp(error, "line 256: \"tx\"; allowed: 255 rows") == 0, "256 are none: %s", error);
    plcPointersFree(t);
}

MAIN(pointersTest)
{
    testPlan(5 + 1 + 2 + 20);
    goodFiles();
    longLine();
    manyRows();
    badFiles();
    return testDone();
}

/* PLC clocks: literal bytes of DATE_AND_TIME (BCD) and DTL, and the EPICS time they mean. */
#include <stdio.h>
#include <string.h>

#include <epicsTime.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcClock.h"

enum { DT, DTL_BIG, DTL_LITTLE };

static const struct {
    const char *sentence;
    int format;
    const char *bytes;
    int bad;
    const char *utc; /* year-month-day hour:minute:second.nanoseconds */
} rows[] = {
    {"DT 1990-01-01, where EPICS time begins", DT, "\x90\x01\x01\x00\x00\x00\x00\x02", 0,
     "1990-01-01 00:00:00.000000000"},
    {"DT 2024-02-29 12:34:56.789, leap day", DT, "\x24\x02\x29\x12\x34\x56\x78\x95", 0,
     "2024-02-29 12:34:56.789000000"},
    {"DT 1999-12-31 23:59:59.999", DT, "\x99\x12\x31\x23\x59\x59\x99\x96", 0,
     "1999-12-31 23:59:59.999000000"},
    {"DT 2000-02-29: 2000 is a leap year", DT, "\x00\x02\x29\x00\x00\x00\x00\x03", 0,
     "2000-02-29 00:00:00.000000000"},
    {"DT 2000-03-01", DT, "\x00\x03\x01\x00\x00\x00\x00\x04", 0,
     "2000-03-01 00:00:00.000000000"},
    {"DT 2089-12-31, the last year that DT knows", DT, "\x89\x12\x31\x23\x59\x59\x00\x07", 0,
     "2089-12-31 23:59:59.000000000"},
    {"DT ms: hundreds and tens in byte 6, ones in byte 7", DT,
     "\x26\x11\x23\x08\x09\x10\x12\x31", 0, "2026-11-23 08:09:10.123000000"},
    {"DT weekday 0 does no harm", DT, "\x26\x11\x23\x08\x09\x10\x00\x00", 0,
     "2026-11-23 08:09:10.000000000"},
    {"DT all zero (clock never set): month 0 is no date", DT,
     "\x00\x00\x00\x00\x00\x00\x00\x00", 1, ""},
    {"DT all FF is no date", DT, "\xff\xff\xff\xff\xff\xff\xff\xff", 1, ""},
    {"DT hexadecimal digit in the minute", DT, "\x24\x02\x28\x12\x3A\x56\x78\x95", 1, ""},
    {"DT month 13", DT, "\x24\x13\x01\x00\x00\x00\x00\x01", 1, ""},
    {"DT 30 February", DT, "\x24\x02\x30\x00\x00\x00\x00\x01", 1, ""},
    {"DT 29 February of a year that has none", DT, "\x23\x02\x29\x00\x00\x00\x00\x01", 1, ""},
    {"DT 32 January of a leap year", DT, "\x24\x01\x32\x00\x00\x00\x00\x01", 1, ""},
    {"DT day 0", DT, "\x24\x02\x00\x00\x00\x00\x00\x01", 1, ""},
    {"DT hour 24", DT, "\x24\x02\x01\x24\x00\x00\x00\x01", 1, ""},
    {"DT minute 60", DT, "\x24\x02\x01\x00\x60\x00\x00\x01", 1, ""},
    {"DT second 60", DT, "\x24\x02\x01\x00\x00\x60\x00\x01", 1, ""},
    {"DT ms digit that is no digit", DT, "\x24\x02\x01\x00\x00\x00\x00\xA1", 1, ""},

    {"DTL big endian 2024-02-29 12:34:56.123456789", DTL_BIG,
     "\x07\xE8\x02\x1D\x05\x0C\x22\x38\x07\x5B\xCD\x15", 0, "2024-02-29 12:34:56.123456789"},
    {"DTL little endian, the same", DTL_LITTLE,
     "\xE8\x07\x02\x1D\x05\x0C\x22\x38\x15\xCD\x5B\x07", 0, "2024-02-29 12:34:56.123456789"},
    {"DTL 1990-01-01", DTL_BIG, "\x07\xC6\x01\x01\x02\x00\x00\x00\x00\x00\x00\x00", 0,
     "1990-01-01 00:00:00.000000000"},
    {"DTL 2100-03-01: 2100 is no leap year", DTL_BIG,
     "\x08\x34\x03\x01\x02\x00\x00\x00\x00\x00\x00\x00", 0, "2100-03-01 00:00:00.000000000"},
    {"DTL 2100-02-29 does not exist", DTL_BIG,
     "\x08\x34\x02\x1D\x02\x00\x00\x00\x00\x00\x00\x00", 1, ""},
    {"DTL 1970-01-01 (clock never set) is before EPICS time", DTL_BIG,
     "\x07\xB2\x01\x01\x05\x00\x00\x00\x00\x00\x00\x00", 1, ""},
    {"DTL all zero is no date", DTL_BIG, "\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00", 1,
     ""},
    {"DTL 2125-12-31, the last year of EPICS time", DTL_BIG,
     "\x08\x4D\x0C\x1F\x02\x17\x3B\x3B\x00\x00\x00\x00", 0, "2125-12-31 23:59:59.000000000"},
    {"DTL 2200 is beyond EPICS time", DTL_BIG,
     "\x08\x98\x01\x01\x04\x00\x00\x00\x00\x00\x00\x00", 1, ""},
    {"DTL 1000000000 ns are no fraction", DTL_BIG,
     "\x07\xE8\x02\x1D\x05\x0C\x22\x38\x3B\x9A\xCA\x00", 1, ""},
    {"DTL 999999999 ns are one", DTL_BIG,
     "\x07\xE8\x02\x1D\x05\x0C\x22\x38\x3B\x9A\xC9\xFF", 0, "2024-02-29 12:34:56.999999999"},
    {"DTL in the wrong byte order is no date", DTL_LITTLE,
     "\x07\xE8\x02\x1D\x05\x0C\x22\x38\x07\x5B\xCD\x15", 1, ""},
};

static void testRow(size_t row)
{
    epicsTimeStamp stamp = {42, 42};
    char utc[60] = "";
    struct tm tm;
    unsigned long ns;
    int status;

    if (rows[row].format == DT)
        status = plcClockDateAndTime(rows[row].bytes, &stamp);
    else
        status = plcClockDtl(rows[row].bytes, rows[row].format == DTL_BIG, &stamp);
    if (rows[row].bad) {
        testOk(status == -1 && stamp.secPastEpoch == 42 && stamp.nsec == 42, "%s",
               rows[row].sentence);
        return;
    }
    if (sizeof(time_t) < 8 && stamp.secPastEpoch > 0x7fffffffu - POSIX_TIME_AT_EPICS_EPOCH) {
        testSkip(1, "time_t of this machine ends in 2038");
        return;
    }
    if (epicsTimeToGMTM(&tm, &ns, &stamp) == epicsTimeOK) {
        size_t used = strftime(utc, sizeof(utc), "%Y-%m-%d %H:%M:%S", &tm);

        snprintf(utc + used, sizeof(utc) - used, ".%09lu", ns);
    }
    if (!testOk(status == 0 && strcmp(utc, rows[row].utc) == 0, "%s", rows[row].sentence))
        testDiag("got %s", utc);
}

/* Each day that DT can tell follows the one before by 86400 s. */
static void testAllDays(void)
{
    static const int length[] = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};
    epicsUInt32 expected = 0;
    int year, month, day, wrong = 0, days = 0;

    for (year = 1990; year <= 2089; year++)
        for (month = 1; month <= 12; month++) {
            int last = length[month - 1] + (month == 2 && year % 4 == 0);

            for (day = 1; day <= last; day++, days++, expected += 86400) {
                unsigned char dt[8] = {0};
                epicsTimeStamp stamp;

                dt[0] = (unsigned char)(year % 100 / 10 << 4 | year % 10);
                dt[1] = (unsigned char)(month / 10 << 4 | month % 10);
                dt[2] = (unsigned char)(day / 10 << 4 | day % 10);
                wrong += plcClockDateAndTime(dt, &stamp) || stamp.secPastEpoch != expected;
            }
        }
    testOk(wrong == 0 && days == 36524 + 1, "all %d days from 1990 to 2089", days);
}

MAIN(clockTest)
{
    size_t i;

    testPlan((int)(sizeof(rows) / sizeof(rows[0])) + 1);
    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++)
        testRow(i);
    testAllDays();
    return testDone();
}

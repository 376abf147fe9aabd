/* PLC clocks; see plcClock.h. */
#include "plcClock.h"
#include "plcCodec.h"

typedef struct plcDate {
    int year, month, day, hour, minute, second;
    epicsUInt32 nanosecond;
} plcDate;

static int isLeap(int year)
{
    return (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
}

/* Days from 1990-01-01, where EPICS time begins. */
static epicsUInt32 daysSince1990(const plcDate *d)
{
    static const int before[] = {0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334};
    epicsUInt32 days = before[d->month - 1] + d->day - 1;
    int year;

    for (year = 1990; year < d->year; year++)
        days += isLeap(year) ? 366 : 365;
    return days + (d->month > 2 && isLeap(d->year));
}

static int toStamp(const plcDate *d, epicsTimeStamp *stamp)
{
    static const int length[] = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};

    /* EPICS time, 32 bits of seconds, ends in 2126 */
    if (d->year < 1990 || d->year > 2125 || d->month < 1 || d->month > 12 || d->day < 1 ||
        d->day > length[d->month - 1] + (d->month == 2 && isLeap(d->year)) ||
        d->hour > 23 || d->minute > 59 || d->second > 59 || d->nanosecond > 999999999)
        return -1;
    stamp->secPastEpoch = daysSince1990(d) * 86400u +
                          (epicsUInt32)(d->hour * 3600 + d->minute * 60 + d->second);
    stamp->nsec = d->nanosecond;
    return 0;
}

int plcClockDateAndTime(const void *bytes, epicsTimeStamp *stamp)
{
    const epicsUInt8 *b = bytes;
    epicsUInt8 n[8];
    plcDate d;
    int i;

    for (i = 0; i < 8; i++)
        if (b[i] >> 4 > 9 || (i < 7 && (b[i] & 15) > 9))
            return -1;
    plcBcdDecode(n, b, 8);
    d.year = n[0] + (n[0] < 90 ? 2000 : 1900);
    d.month = n[1];
    d.day = n[2];
    d.hour = n[3];
    d.minute = n[4];
    d.second = n[5];
    d.nanosecond = (n[6] * 10u + (b[7] >> 4)) * 1000000u;
    return toStamp(&d, stamp);
}

int plcClockDtl(const void *bytes, int bigEndian, epicsTimeStamp *stamp)
{
    const epicsUInt8 *b = bytes;
    plcDate d;

    d.year = (int)plcGetInt(plcTypeOf(plcUnsigned, 2), b, bigEndian);
    d.month = b[2];
    d.day = b[3];
    d.hour = b[5];
    d.minute = b[6];
    d.second = b[7];
    d.nanosecond = (epicsUInt32)plcGetInt(plcTypeOf(plcUnsigned, 4), b + 8, bigEndian);
    return toStamp(&d, stamp);
}

/* What records make of the bytes of a block, and which bytes they write: conversions,
 * limits, masks, texts, arrays. Bytes are literal, most significant first.
 */
#include <string.h>

#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "recordTest.h"

#define SLOT 64 /* bytes of the block for one row */

/* --- Inputs: bytes -> field --------------------------------------------------------- */

static const struct {
    const char *title;
    const char *record;
    const char *options; /* behind the offset */
    const char *fields;
    const char *bytes;
    const char *field, *expected;
} inputs[] = {
    /* ai */
    {"ai without options reads a signed 16 bit number", "ai", "", "", "fffe", "VAL",
     "-2"},
    {"ai shows the number of the PLC in RVAL", "ai", "", "", "fffe", "RVAL", "-2"},
    {"ai LINEAR maps H to EGUF", "ai", " T=INT16 L=0 H=1000",
     "LINR=LINEAR|EGUL=-5|EGUF=5",
     "03e8", "VAL", "5"},
    {"ai LINEAR maps L to EGUL", "ai", " T=INT16 L=0 H=1000",
     "LINR=LINEAR|EGUL=-5|EGUF=5",
     "0000", "VAL", "-5"},
    {"ai LINEAR maps the middle of L to H", "ai", " T=INT16 L=0 H=1000",
     "LINR=LINEAR|EGUL=-5|EGUF=5", "01f4", "VAL", "0"},
    {"ai LINEAR goes beyond H", "ai", " T=INT16 L=0 H=1000", "LINR=LINEAR|EGUL=0|EGUF=10",
     "07d0", "VAL", "20"},
    {"ai LINEAR has symmetric default limits", "ai", "", "LINR=LINEAR|EGUL=-10|EGUF=10",
     "8001", "VAL", "-10"},
    {"ai LINEAR goes a little below the default L", "ai", "",
     "LINR=LINEAR|EGUL=-32767|EGUF=32767", "8000", "VAL", "-32768"},
    {"ai LINEAR maps all of UINT8", "ai", " T=BYTE", "LINR=LINEAR|EGUL=0|EGUF=100", "ff",
     "VAL", "100"},
    {"ai takes a negative L and H=0", "ai", " L=-100 H=0", "LINR=LINEAR|EGUL=0|EGUF=1",
     "ffce", "VAL", "0.5"},
    {"ai takes hex limits", "ai", " T=UINT32 H=0x00ffffff",
     "LINR=LINEAR|EGUL=-10|EGUF=10",
     "00ffffff", "VAL", "10"},
    {"ai LINEAR then ASLO and AOFF", "ai", " L=0 H=100",
     "LINR=LINEAR|EGUL=0|EGUF=10|ASLO=2|AOFF=5", "000a", "VAL", "2.5"},
    {"ai SLOPE uses ESLO and EOFF as given", "ai", "", "LINR=SLOPE|ESLO=3|EOFF=1", "0002",
     "VAL", "7"},
    {"ai SLOPE: ((RVAL + ROFF) * ASLO + AOFF) * ESLO + EOFF", "ai", "",
     "LINR=SLOPE|ROFF=2|ASLO=5|AOFF=7|ESLO=3|EOFF=1", "0004", "VAL", "112"},
    {"ai UINT32: ((RVAL + ROFF) * ASLO + AOFF) * ESLO + EOFF", "ai", " T=DWORD",
     "LINR=SLOPE|ROFF=2|ASLO=5|AOFF=7|ESLO=3|EOFF=1", "80000000", "VAL", "32212254772"},
    {"ai NO CONVERSION uses ASLO and AOFF", "ai", "", "ASLO=0.5|AOFF=100|ESLO=7|EOFF=9", "0004",
     "VAL", "102"},
    {"ai adds ROFF", "ai", "", "ROFF=3", "0004", "VAL", "7"},
    {"ai UINT32 stays positive", "ai", " T=UINT32", "", "ffffffff", "VAL", "4294967295"},
    {"ai UINT32 at the edge of 31 bits", "ai", " T=UINT32", "", "80000000", "VAL",
     "2147483648"},
    {"ai UINT32 LINEAR maps H to EGUF", "ai", " T=DWORD", "LINR=LINEAR|EGUL=-10|EGUF=10",
     "ffffffff", "VAL", "10"},
    {"ai UINT32 SLOPE above 31 bits", "ai", " T=DWORD", "LINR=SLOPE|ESLO=2|EOFF=1",
     "c0000000", "VAL", "6442450945"},
    {"ai UINT32 above 31 bits uses ROFF, ASLO, AOFF", "ai", " T=DWORD",
     "ROFF=1|ASLO=2|AOFF=3", "ffffffff", "VAL", "8589934595"},
    {"ai UINT32 goes through a breakpoint table", "ai", " T=DWORD", "LINR=typeKdegC",
     "00000000",
     "VAL", "0"},
    {"ai UINT32 takes the middle of a piece of its breakpoint table", "ai", " T=DWORD",
     "LINR=typeKdegC|ASLO=0.01|AOFF=-0.50565|ESLO=7|EOFF=9", "00003aa6", "VAL", "37.0"},
    {"ai goes through a breakpoint table instead of ESLO and EOFF", "ai", " T=WORD",
     "LINR=typeKdegC|ASLO=0.01|AOFF=-0.0013|ESLO=7|EOFF=9", "74e7", "VAL", "74.0"},
    {"ai beyond its breakpoint table has a SOFT alarm", "ai", " T=DWORD", "LINR=typeKdegC",
     "ffffffff", "STAT", "SOFT"},
    {"ai float goes to VAL as it is", "ai", " T=FLOAT", "", "c0490fdb", "VAL",
     "-3.14159274101257"},
    {"ai float uses ASLO and AOFF", "ai", " T=FLOAT", "ASLO=2|AOFF=1", "41200000", "VAL",
     "21"},
    {"ai float takes ASLO=0 as 1", "ai", " T=FLOAT", "ASLO=0|AOFF=1", "41200000", "VAL",
     "11"},
    {"ai float ignores LINEAR", "ai", " T=FLOAT", "LINR=LINEAR|EGUL=0|EGUF=1", "41200000",
     "VAL", "10"},
    {"ai float leaves RVAL alone", "ai", " T=FLOAT", "", "41200000", "RVAL", "0"},
    {"ai double", "ai", " T=DOUBLE", "", "3fb999999999999a", "VAL", "0.1"},
    {"ai FLOAT64 is a double", "ai", " T=FLOAT64", "", "3fb999999999999a", "VAL", "0.1"},
    {"ai takes types in lower case", "ai", " T=float", "", "41200000", "VAL", "10"},
    {"ai NaN from the PLC is undefined", "ai", " T=FLOAT", "", "7fc00000", "UDF", "1"},
    {"ai infinity from the PLC is a value", "ai", " T=FLOAT", "", "7f800000", "VAL",
     "inf"},
    /* links */
    {"offset sums", "ai", "+1+2", "", "000000fffe", "VAL", "-2"},
    {"options in quotes", "ai", " 'T=UINT8 L=0 H=255'", "", "fe", "VAL", "254"},
    {"options in any order, several blanks, blanks at the end", "ai",
     "   H=255  L=0   T=BYTE  ",
     "LINR=LINEAR|EGUL=0|EGUF=255", "fe", "VAL", "254"},
    /* bits */
    {"bi reads bit 0 of a word: in the second byte", "bi", "", "", "0001", "VAL", "1"},
    {"bi reads no other bit", "bi", "", "", "fffe", "VAL", "0"},
    {"bi reads bit 15 of a word: in the first byte", "bi", " B=15", "", "8000", "VAL",
     "1"},
    {"bi shows the bit in its place in RVAL", "bi", " B=14", "", "4000", "RVAL", "16384"},
    {"bi shows a bit of 64 as 1 in RVAL", "bi", " T=QWORD B=20", "", "0000000000100000",
     "RVAL", "1"},
    {"bi reads bit 7 of a byte", "bi", " T=BYTE B=7", "", "80", "VAL", "1"},
    {"bi reads bit 31 of a double word", "bi", " T=DWORD B=31", "", "80000000", "VAL",
     "1"},
    {"bi reads bit 32 of 64", "bi", " T=QWORD B=32", "", "0000000100000000", "VAL", "1"},
    {"bi reads bit 63 of 64", "bi", " T=LONGLONG B=63", "", "8000000000000000", "VAL",
     "1"},
    {"bi does not take bit 31 for bit 63", "bi", " T=INT64 B=63", "", "0000000080000000",
     "VAL", "0"},
    {"mbbi reads NOBT bits", "mbbi", "", "NOBT=4", "1234", "VAL", "4"},
    {"mbbi reads NOBT bits from SHFT on", "mbbi", "", "NOBT=4|SHFT=8", "1234", "VAL",
     "2"},
    {"mbbi finds the state of the number", "mbbi", "", "NOBT=4|SHFT=4|ZRVL=5|ONVL=3",
     "1234",
     "VAL", "1"},
    {"mbbi does not extend the sign of a byte", "mbbi", " T=INT8", "NOBT=8", "a6",
     "RVAL",
     "166"},
    {"mbbi with more bits than its type reads those there are", "mbbi", " T=BYTE", "NOBT=11", "b8",
     "RVAL", "184"},
    {"mbbi without NOBT reads 0", "mbbi", "", "", "1234", "VAL", "0"},
    {"mbbi NOBT=32 reads all of a double word", "mbbi", " T=DWORD",
     "NOBT=32|ONVL=0x81020304",
     "81020304", "VAL", "1"},
    {"mbbiDirect reads NOBT bits from SHFT on", "mbbiDirect", "", "NOBT=7|SHFT=3", "02a8",
     "VAL", "85"},
    {"mbbiDirect sets its bits", "mbbiDirect", "", "NOBT=16", "8001", "BF", "1"},
    /* whole numbers */
    {"longin extends the sign of a byte", "longin", " T=INT8", "", "80", "VAL", "-128"},
    {"longin does not extend a byte without sign", "longin", " T=BYTE", "", "80", "VAL",
     "128"},
    {"longin UINT32 shows big numbers negative", "longin", " T=DWORD", "", "ffffffff",
     "VAL",
     "-1"},
    {"int64in UINT32 shows big numbers as they are", "int64in", " T=DWORD", "",
     "ffffffff",
     "VAL", "4294967295"},
    {"int64in reads 64 bits", "int64in", " T=INT64", "", "8000000000000001", "VAL",
     "-9223372036854775807"},
    {"int64in reads a word by default", "int64in", "", "", "fffe", "VAL", "-2"},
    /* texts */
    {"stringin reads up to the first NUL", "stringin", "", "", "48656c6c6f00585858",
     "VAL",
     "Hello"},
    {"stringin reads L bytes without NUL", "stringin", " L=4", "", "48656c6c6f", "VAL",
     "Hell"},
    {"stringin reads at most 39 characters", "stringin", "", "",
     "30313233343536373839303132333435363738393031323334353637383930313233343536373839",
     "VAL", "012345678901234567890123456789012345678"},
    {"stringin reduces L=60 to 40", "stringin", " L=60", "",
     "30313233343536373839303132333435363738393031323334353637383930313233343536373839",
     "VAL", "012345678901234567890123456789012345678"},
    {"stringin is defined after reading", "stringin", " L=4", "", "41", "UDF", "0"},
    {"lsi reads SIZV bytes by default", "lsi", "", "SIZV=50",
     "3031323334353637383930313233343536373839303132333435363738393031323334353637383930"
     "31323334353637383958585858",
     "VAL", "0123456789012345678901234567890123456789012345678"},
    {"lsi reads L bytes", "lsi", " L=3", "SIZV=50", "414243444546", "VAL", "ABC"},
    {"lsi counts the terminator in LEN", "lsi", " L=3", "SIZV=50", "414243444546",
     "LEN", "4"},
    {"lsi ends at the first NUL", "lsi", "", "SIZV=50", "410042", "LEN", "2"},
    {"stringin S7STRING reads its present length", "stringin", " T=S7STRING L=6", "",
     "0603414243444546", "VAL", "ABC"},
    {"stringin S7STRING stops at L whatever the length byte says", "stringin",
     " T=S7STRING L=3", "", "03ff414243444546", "VAL", "ABC"},
    {"stringin S7STRING shows the 39 characters that it holds", "stringin",
     " T=S7STRING L=50", "",
     "3232303132333435363738393031323334353637383930313233343536373839303132333435363738"
     "393031323334353637383930", "VAL", "012345678901234567890123456789012345678"},
    {"lsi S7STRING reads its present length", "lsi", " T=S7STRING L=60", "SIZV=61",
     "3c05414243444546", "VAL", "ABCDE"},
    {"lsi S7STRING counts the terminator in LEN", "lsi", " T=S7STRING L=60", "SIZV=61",
     "3c05414243444546", "LEN", "6"},
    {"waveform S7STRING has its characters", "waveform", " T=S7STRING L=4",
     "FTVL=CHAR|NELM=6", "04034142434445", "VAL", "65,66,67"},
    {"waveform S7STRING has their number in NORD", "waveform", " T=S7STRING L=4",
     "FTVL=CHAR|NELM=6", "04034142434445", "NORD", "3"},
    {"waveform S7STRING that is longer than the array", "waveform", " T=S7STRING L=4",
     "FTVL=CHAR|NELM=2", "04034142434445", "VAL", "65,66"},
    /* arrays */
    {"waveform reads NELM elements", "waveform", "", "FTVL=SHORT|NELM=3",
     "0001ffff000300040005", "VAL", "1,-1,3"},
    {"waveform sets NORD to NELM", "waveform", "", "FTVL=SHORT|NELM=3", "0001",
     "NORD", "3"},
    {"waveform T=INT16 into USHORT", "waveform", " T=INT16", "FTVL=USHORT|NELM=2",
     "ffff0001", "VAL", "65535,1"},
    {"waveform FTVL=ULONG without T", "waveform", "", "FTVL=ULONG|NELM=1", "ffffffff",
     "VAL",
     "4294967295"},
    {"waveform FTVL=ENUM reads words", "waveform", "", "FTVL=ENUM|NELM=2", "00010002",
     "VAL",
     "1,2"},
    {"waveform T=STRING reads NELM bytes by default", "waveform", " T=STRING",
     "FTVL=CHAR|NELM=4", "4142434445", "VAL", "65,66,67,68"},
    {"waveform T=STRING reads L bytes", "waveform", " T=STRING L=2", "FTVL=CHAR|NELM=4",
     "4142434445", "VAL", "65,66,0,0"},
    {"waveform T=STRING reduces L to NELM", "waveform", " T=STRING L=9",
     "FTVL=CHAR|NELM=4",
     "4142434445", "VAL", "65,66,67,68"},
    {"waveform T=STRING L=2 has NORD=NELM", "waveform", " T=STRING L=2",
     "FTVL=CHAR|NELM=4",
     "4142434445", "NORD", "4"},
    {"waveform T=TIME reads a time stamp of the PLC", "waveform", " T=TIME",
     "FTVL=CHAR|NELM=8", "2612312359591234", "VAL", "26,12,31,23,59,59,12,34"},
    {"waveform T=BCD is the same", "waveform", " T=BCD", "FTVL=UCHAR|NELM=2", "9900",
     "VAL",
     "99,0"},
    {"waveform T=TIME shows digits that are none", "waveform", " T=TIME",
     "FTVL=UCHAR|NELM=1", "ff", "VAL", "165"},
    {"aai reads NELM elements", "aai", "", "FTVL=DOUBLE|NELM=2",
     "3ff00000000000004000000000000000", "VAL", "1,2"},
    {"aai sets NORD to NELM", "aai", "", "FTVL=SHORT|NELM=3", "0001", "NORD", "3"},
    {"aai S7STRING has their number in NORD", "aai", " T=S7STRING L=4",
     "FTVL=CHAR|NELM=6", "04034142434445", "NORD", "3"},
    {"aai T=TIME", "aai", " T=TIME", "FTVL=CHAR|NELM=2", "5958", "VAL", "59,58"},
};

/* --- Outputs: field -> bytes -------------------------------------------------------- */

static const struct {
    const char *title;
    const char *record;
    const char *options;
    const char *fields;
    const char *field, *value; /* what is put */
    const char *before;        /* bytes in the image */
    const char *bytes;         /* afterwards */
} outputs[] = {
    /* ao */
    {"ao without options writes a signed 16 bit number", "ao", "", "", "VAL", "-2", "",
     "fffe"},
    {"ao rounds", "ao", "", "", "VAL", "2.5", "", "0003"},
    {"ao rounds negative numbers", "ao", "", "", "VAL", "-2.5", "", "fffd"},
    {"ao never writes less than the default L", "ao", "", "", "VAL", "-40000", "",
     "8001"},
    {"ao never writes more than the default H", "ao", "", "", "VAL", "40000", "", "7fff"},
    {"ao never writes less than L", "ao", " L=-100 H=100", "", "VAL", "-1e9", "", "ff9c"},
    {"ao never writes more than H", "ao", " L=-100 H=100", "", "VAL", "1e9", "", "0064"},
    {"ao keeps L=-100 H=0 as limits", "ao", " L=-100 H=0", "", "VAL", "5", "", "0000"},
    {"ao LINEAR maps EGUF to H", "ao", " L=0 H=1000", "LINR=LINEAR|EGUL=-5|EGUF=5", "VAL",
     "5", "", "03e8"},
    {"ao LINEAR maps EGUL to L", "ao", " L=0 H=1000", "LINR=LINEAR|EGUL=-5|EGUF=5", "VAL",
     "-5", "ffff", "0000"},
    {"ao LINEAR stops at H", "ao", " L=0 H=1000", "LINR=LINEAR|EGUL=0|EGUF=10", "VAL",
     "20",
     "", "03e8"},
    {"ao LINEAR after AOFF and ASLO", "ao", " L=0 H=100",
     "LINR=LINEAR|EGUL=0|EGUF=10|ASLO=2|AOFF=5", "VAL", "2.5", "", "000a"},
    {"ao SLOPE uses ESLO and EOFF as given", "ao", "", "LINR=SLOPE|ESLO=3|EOFF=1", "VAL",
     "7", "", "0002"},
    {"ao SLOPE: ((OVAL - EOFF) / ESLO - AOFF) / ASLO - ROFF", "ao", "",
     "LINR=SLOPE|ROFF=2|ASLO=5|AOFF=7|ESLO=3|EOFF=1", "VAL", "112", "", "0004"},
    {"ao NO CONVERSION uses ASLO and AOFF", "ao", "", "ASLO=0.5|AOFF=100|ESLO=7|EOFF=9", "VAL",
     "102", "", "0004"},
    {"ao UINT8 stops at 0", "ao", " T=BYTE", "", "VAL", "-1", "ff", "00"},
    {"ao UINT8 stops at 255", "ao", " T=BYTE", "", "VAL", "300", "", "ff"},
    {"ao INT8 stops at -127", "ao", " T=INT8", "", "VAL", "-128", "", "81"},
    {"ao INT8 writes -128 when L allows it", "ao", " T=INT8 L=-128 H=127", "", "VAL",
     "-200",
     "", "80"},
    {"ao UINT8 stops at 0 with an L below 0", "ao", " T=BYTE L=-100 H=100", "", "VAL",
     "-50",
     "ff", "00"},
    {"ao LINEAR maps an L below the type", "ao", " T=BYTE L=-100 H=100",
     "LINR=LINEAR|EGUL=-1|EGUF=1", "VAL", "0.5", "", "32"},
    {"ao UINT16 stops at 0", "ao", " T=WORD", "", "VAL", "-1", "ffff", "0000"},
    {"ao UINT32 reaches 4294967295", "ao", " T=DWORD", "", "VAL", "4294967295", "",
     "ffffffff"},
    {"ao UINT32 at the edge of 31 bits", "ao", " T=DWORD", "", "VAL", "2147483647", "",
     "7fffffff"},
    {"ao UINT32 over the edge of 31 bits", "ao", " T=DWORD", "", "VAL", "2147483648", "",
     "80000000"},
    {"ao UINT32 stops at 4294967295", "ao", " T=DWORD", "", "VAL", "1e12", "",
     "ffffffff"},
    {"ao UINT32 stops at 0", "ao", " T=DWORD", "", "VAL", "-5", "ffffffff", "00000000"},
    {"ao UINT32 stops at H", "ao", " T=UINT32 H=0x00ffffff", "", "VAL", "1e9", "",
     "00ffffff"},
    {"ao UINT32 LINEAR maps EGUF to H", "ao", " T=DWORD", "LINR=LINEAR|EGUL=-10|EGUF=10",
     "VAL", "10", "", "ffffffff"},
    {"ao INT32 stops at 2147483647", "ao", " T=INT32", "", "VAL", "1e12", "", "7fffffff"},
    {"ao INT32 stops at -2147483647", "ao", " T=INT32", "", "VAL", "-1e12", "",
     "80000001"},
    {"ao obeys OROC", "ao", "", "OROC=1", "VAL", "5", "", "0001"},
    {"ao float writes OVAL", "ao", " T=FLOAT", "", "VAL", "0.5", "", "3f000000"},
    {"ao float writes (OVAL-AOFF)/ASLO", "ao", " T=FLOAT", "ASLO=2|AOFF=1", "VAL",
     "21", "",
     "41200000"},
    {"ao float takes ASLO=0 as 1", "ao", " T=FLOAT", "ASLO=0|AOFF=1", "VAL", "11", "",
     "41200000"},
    {"ao float ignores LINEAR and limits", "ao", " T=FLOAT", "LINR=LINEAR|EGUF=1", "VAL",
     "10", "", "41200000"},
    {"ao float writes NaN", "ao", " T=FLOAT", "", "VAL", "nan", "", "7fc00000"},
    {"ao float beyond its range writes infinity", "ao", " T=FLOAT", "", "VAL",
     "1e300", "",
     "7f800000"},
    {"ao double", "ao", " T=DOUBLE", "", "VAL", "0.1", "", "3fb999999999999a"},
    {"ao integer writes nothing for NaN", "ao", "", "", "VAL", "nan", "1234", "1234"},
    {"ao integer stops infinity at H", "ao", "", "", "VAL", "inf", "", "7fff"},
    /* calcout */
    {"calcout writes OVAL", "calcout", "", "CALC=A*2", "A", "21", "", "002a"},
    {"calcout writes the result of OCAL", "calcout", "",
     "CALC=0|OCAL=A*3|DOPT=Use OCAL", "A",
     "2", "", "0006"},
    {"calcout cuts off the fraction", "calcout", " T=INT8", "CALC=A", "A", "-5.7", "",
     "fb"},
    {"calcout stops at the default L", "calcout", "", "CALC=A", "A", "-1e6", "", "8001"},
    {"calcout stops at H", "calcout", " H=100", "CALC=A", "A", "101", "", "0064"},
    {"calcout UINT32 reaches 4294967295", "calcout", " T=DWORD", "CALC=A", "A",
     "4294967295",
     "", "ffffffff"},
    {"calcout writes nothing for NaN", "calcout", "", "CALC=A", "A", "nan", "1234",
     "1234"},
    {"calcout float writes NaN", "calcout", " T=FLOAT", "CALC=A", "A", "nan", "", "7fc00000"},
    {"calcout float", "calcout", " T=FLOAT", "CALC=A", "A", "0.5", "", "3f000000"},
    /* bits */
    {"bo sets its bit, the others stay", "bo", " B=4", "", "VAL", "1", "a5a5", "a5b5"},
    {"bo clears its bit, the others stay", "bo", " B=0", "", "VAL", "0", "a5a5", "a5a4"},
    {"bo bit 7 of a byte leaves its neighbours", "bo", " T=BYTE B=7", "", "VAL", "1",
     "0055",
     "8055"},
    {"bo sets bit 62 of 64", "bo", " T=QWORD B=62", "", "VAL", "1", "",
     "4000000000000000"},
    {"bo clears bit 63 of 64", "bo", " T=INT64 B=63", "", "VAL", "0", "ffffffffffffffff",
     "7fffffffffffffff"},
    {"mbbo writes its NOBT bits, the others stay", "mbbo", "", "NOBT=4|SHFT=4", "VAL",
     "3",
     "a5a5", "a535"},
    {"mbbo writes the number of the state", "mbbo", "", "NOBT=4|SHFT=4|ONVL=9", "VAL",
     "1",
     "ffff", "ff9f"},
    {"mbbo cuts a number off at NOBT bits", "mbbo", "", "NOBT=4|SHFT=4|ONVL=18",
     "VAL", "1",
     "", "0020"},
    {"mbbo without NOBT writes nothing", "mbbo", "", "", "VAL", "3", "a5a5", "a5a5"},
    {"mbboDirect writes its bits, the others stay", "mbboDirect", "", "NOBT=4|SHFT=8",
     "VAL",
     "5", "a5a5", "a5a5"},
    {"mbboDirect writes one of its bits", "mbboDirect", "", "NOBT=8|VAL=0", "B1", "1",
     "ff00", "ff02"},
    /* whole numbers */
    {"longout cuts 300 off to a byte", "longout", " T=INT8", "", "VAL", "300", "", "2c"},
    {"longout writes -1 as a word", "longout", " T=WORD", "", "VAL", "-1", "", "ffff"},
    {"longout ignores L and H", "longout", " L=0 H=10", "", "VAL", "300", "", "012c"},
    {"int64out writes 64 bits", "int64out", " T=INT64", "", "VAL", "-2", "",
     "fffffffffffffffe"},
    {"int64out cuts 70000 off to a word", "int64out", "", "", "VAL", "70000", "", "1170"},
    {"int64out writes all of UINT32", "int64out", " T=DWORD", "", "VAL", "4294967295", "",
     "ffffffff"},
    /* texts */
    {"stringout fills up with NULs", "stringout", " L=8", "", "VAL", "abc",
     "5858585858585858", "6162630000000000"},
    {"stringout cuts off at L", "stringout", " L=3", "", "VAL", "abcdef", "5858585858",
     "6162635858"},
    {"stringout writes 40 bytes by default", "stringout", "", "", "VAL", "a",
     "5858585858585858585858585858585858585858585858585858585858585858585858585858585858",
     "6100000000000000000000000000000000000000000000000000000000000000000000000000000058"},
    {"stringout reduces L=60 to 40", "stringout", " L=60", "", "VAL", "a",
     "5858585858585858585858585858585858585858585858585858585858585858585858585858585858",
     "6100000000000000000000000000000000000000000000000000000000000000000000000000000058"},
    {"lso fills up with NULs", "lso", " L=5", "SIZV=50", "VAL", "abc", "585858585858",
     "616263000058"},
    {"lso writes a long text", "lso", "", "SIZV=50", "VAL",
     "0123456789012345678901234567890123456789X", "",
     "3031323334353637383930313233343536373839303132333435363738393031323334353637383958"
     "00"},
    {"stringout S7STRING writes both lengths", "stringout", " T=S7STRING L=5", "", "VAL",
     "abc", "5858585858585858", "050361626300""0058"},
    {"stringout S7STRING cuts off at L", "stringout", " T=S7STRING L=2", "", "VAL", "abc",
     "5858585858", "0202616258"},
    {"stringout S7STRING of nothing", "stringout", " T=S7STRING L=2", "", "VAL", "",
     "5858585858", "0200000058"},
    {"lso S7STRING writes both lengths", "lso", " T=S7STRING L=4", "SIZV=50", "VAL",
     "abc", "58585858585858", "04036162630058"},
    {"aao S7STRING writes its NORD characters", "aao", " T=S7STRING L=4",
     "FTVL=CHAR|NELM=6", "VAL", "65,66,67", "58585858585858", "04034142430058"},
    {"aao S7STRING ends at a zero", "aao", " T=S7STRING L=4", "FTVL=CHAR|NELM=6", "VAL",
     "65,0,67", "58585858585858", "04014100000058"},
    /* arrays */
    {"aao writes its elements", "aao", "", "FTVL=SHORT|NELM=3", "VAL", "1,-1,3", "",
     "0001ffff0003"},
    {"aao writes all NELM elements", "aao", "", "FTVL=SHORT|NELM=3", "VAL", "1",
     "5858585858585858", "0001000000005858"},
    {"aao T=TIME writes BCD", "aao", " T=TIME", "FTVL=CHAR|NELM=4", "VAL",
     "26,12,31,59", "",
     "26123159"},
    {"aao T=STRING writes L bytes", "aao", " T=STRING L=2", "FTVL=CHAR|NELM=4", "VAL",
     "65,66,67,68", "5858585858", "4142585858"},
    {"aao double", "aao", "", "FTVL=DOUBLE|NELM=1", "VAL", "2", "", "4000000000000000"},
};

#define INPUTS COUNT(inputs)
#define OUTPUTS COUNT(outputs)

static void makeOne(const char *name, const char *record, size_t row, const char *options,
                    const char *fields)
{
    char text[300];

    epicsSnprintf(text, sizeof(text), "%s=@P/%lu%s%s%s", linkField(record),
                  (unsigned long)row * SLOT, options, fields[0] ? "|" : "", fields);
    makeRecord(record, name, text);
}

static void makeAll(epicsUInt8 *block)
{
    char name[40];
    size_t i;

    for (i = 0; i < INPUTS; i++) {
        epicsSnprintf(name, sizeof(name), "in%lu", (unsigned long)i);
        makeOne(name, inputs[i].record, i, inputs[i].options, inputs[i].fields);
        unhex(inputs[i].bytes, block + i * SLOT);
    }
    for (i = 0; i < OUTPUTS; i++) {
        epicsSnprintf(name, sizeof(name), "out%lu", (unsigned long)i);
        makeOne(name, outputs[i].record, i, outputs[i].options, outputs[i].fields);
    }
}

static void testInput(size_t i)
{
    char pv[60];

    epicsSnprintf(pv, sizeof(pv), "in%lu.PROC", (unsigned long)i);
    put(pv, "1");
    epicsSnprintf(pv, sizeof(pv), "in%lu.%s", (unsigned long)i, inputs[i].field);
    isValue(pv, inputs[i].expected, inputs[i].title);
}

static void testOutput(plcStation *station, size_t i)
{
    char pv[60];

    setOutput(station, i * SLOT, outputs[i].before);
    epicsSnprintf(pv, sizeof(pv), "out%lu.%s", (unsigned long)i, outputs[i].field);
    put(pv, outputs[i].value);
    isOutput(station, i * SLOT, outputs[i].bytes, outputs[i].title);
}

/* --- Rows that need more than one step ---------------------------------------------- */

static void testSteps(plcStation *station, epicsUInt8 *block)
{
    put("smoothInt.PROC", "1");
    isValue("smoothInt", "10", "ai integer takes the first value after PINI without "
            "smoothing");
    put("smooth.PROC", "1");
    isValue("smooth", "21", "ai float takes the first value without smoothing");
    unhex("42c80000", block);
    publish(station, block, 2);
    put("smooth.PROC", "1");
    isValue("smooth", "111", "ai float smooths with SMOO after ASLO and AOFF");
    unhex("0014", block + 8);
    publish(station, block, 3);
    put("smoothInt.PROC", "1");
    isValue("smoothInt", "15", "ai integer smooths with SMOO");

    put("linear.LINR", "LINEAR");
    put("linear.PROC", "1");
    isValue("linear", "50", "ai maps L to H as soon as LINR becomes LINEAR");
    put("linear.EGUF", "200");
    put("linear.PROC", "1");
    isValue("linear", "100", "ai follows a new EGUF");

    put("array", "1,2,3");
    put("array", "9");
    isOutput(station, 0, "000900020003", "aao keeps what was behind a shorter put");

    put("cut", "1e9");
    isOutput(station, 48, "0064", "ao stops at H");
    isValue("cut", "1000000000", "and keeps VAL as it was put");
    isValue("cut.RVAL", "1000000000", "and RVAL");

    put("part", "1,2,3,4");
    put("part.PROC", "1");
    isValue("part", "5,6,3,4", "waveform T=STRING L=2 leaves the elements behind L as they are");

    isValue("keep", "7", "ao keeps VAL at init");
    isValue("keepBo", "1", "bo keeps VAL at init");
    isValue("keepMbbo", "3", "mbbo keeps VAL at init");
    isValue("keepMbbo.RVAL", "48", "mbbo has RVAL of its VAL at init");
    isOutput(station, 40, "0000000000000000", "output records write nothing at init");
}

static void makeSteps(epicsUInt8 *block)
{
    unhex("41200000", block);
    makeRecord("ai", "smooth", "INP=@S/0 T=FLOAT|SMOO=0.5|ASLO=2|AOFF=1|PINI=YES");
    unhex("00000032", block + 4);
    unhex("000a", block + 8);
    makeRecord("ai", "smoothInt", "INP=@S/8|SMOO=0.5|PINI=YES");
    makeRecord("ai", "linear", "INP=@S/4 T=DWORD L=0 H=100|EGUL=0|EGUF=100");
    makeRecord("aao", "array", "OUT=@S/0|FTVL=SHORT|NELM=3");
    makeRecord("ao", "cut", "OUT=@S/48 L=-100 H=100");
    unhex("0506", block + 12);
    makeRecord("waveform", "part", "INP=@S/12 T=STRING L=2|FTVL=CHAR|NELM=4");
    makeRecord("ao", "keep", "OUT=@S/40|VAL=7");
    makeRecord("bo", "keepBo", "OUT=@S/42|VAL=1");
    makeRecord("mbbo", "keepMbbo", "OUT=@S/44|VAL=3|NOBT=4|SHFT=4");
}

MAIN(recordTestValues)
{
    static epicsUInt8 block[INPUTS * SLOT], steps[64];
    plcStation *station, *stepStation;
    size_t i;

    testPlan(INPUTS + OUTPUTS + 16);
    iocBegin();
    station = makeStation("P", 1, sizeof(block), OUTPUTS * SLOT);
    stepStation = makeStation("S", 1, sizeof(steps), 64);
    makeAll(block);
    makeSteps(steps);
    iocRunOk();
    publish(station, block, 1);
    publish(stepStation, steps, 1);
    for (i = 0; i < INPUTS; i++)
        testInput(i);
    for (i = 0; i < OUTPUTS; i++)
        testOutput(station, i);
    testSteps(stepStation, steps);
    iocEnd();
    return testDone();
}

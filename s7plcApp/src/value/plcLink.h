/* The text of an INP or OUT link taken apart:
 *
 *     @PLCname/offset T=type L=low H=high B=bit R=readback W=order
 *
 * Pure: knows the data types, but no station, no record and no block size. What a record
 * type allows is one row of constants (plcShape), so that every refusal reads alike.
 */
#ifndef INC_plcLink_H
#define INC_plcLink_H

#include <stddef.h>

#include <epicsTypes.h>

#include "plcCodec.h"

#define PLC_NAME_MAX 255 /* characters of a station name */

/* Which options stood in the text */
#define plcHasT 1
#define plcHasL 2
#define plcHasH 4
#define plcHasB 8
#define plcHasR 16
#define plcHasW 32

/* What W= may be, of numbers and of texts. */
#define PLC_WORD_ORDERS "high low ABCD CDAB BADC DCBA"
#define PLC_TEXT_ORDERS "ABCD CDAB BADC DCBA A0 0A"

#define PLC_NO_COLUMN ((size_t)-1)

typedef struct plcLink {
    char station[PLC_NAME_MAX + 1];
    unsigned has;        /* plcHasT | ... */
    const plcType *type; /* T=, NULL when not given */
    size_t offset;       /* bytes from the start of the block */
    epicsInt64 low;      /* L= */
    epicsInt64 high;     /* H= */
    unsigned bit;        /* B= */
    size_t readback;     /* R=: where in the input block the PLC shows this output */
    int highWordFirst;   /* W=: which 16-bit word of 4 and 8 bytes comes first; -1: not for numbers */
    int wordBigEndian;   /* and which byte in a word, 1: the upper; -1: as everywhere in the PLC */
    int textOrder;       /* plcTextABCD, ...; -1: not for texts */
    struct {             /* columns in the text, for messages; its end when not given */
        size_t offset, T, L, H, B, R, W;
        size_t open; /* a + that nothing follows; PLC_NO_COLUMN: there is none */
    } column;
} plcLink;

/* Why a link text is refused or doubtful, and where: column 0 is the first character. */
typedef struct plcLinkError {
    size_t column;
    char text[800]; /* long enough for what is allowed */
} plcLinkError;

/* Fills in the error. Returns -1, so that a refusal is one line. */
int plcLinkFail(plcLinkError *error, size_t column, const char *format, ...)
    EPICS_PRINTF_STYLE(3, 4);

/* Accepted, but doubtful. The first doubt is told. */
void plcLinkWarn(plcLinkError *error, size_t column, const char *format, ...)
    EPICS_PRINTF_STYLE(3, 4);

/* Parses `text` (with or without the leading '@'). Returns 0, or -1 with *error filled.
 * A text that is accepted but doubtful (an octal number, an option given twice) returns 0
 * with error->text not empty: a warning; else error->text is "". *link is complete only
 * when 0 is returned. Accepts what s7plc accepts: options need no blank between them, an
 * empty L= H= B= is 0, of two equal options the last one counts. */
int plcLinkParse(const char *text, plcLink *link, plcLinkError *error);

/* What a record type allows, and what it means where the link is silent. */
typedef struct plcShape {
    const char *recordType; /* "ai" */
    unsigned kinds;         /* mask of plcKind */
    unsigned maxSize; /* bytes of the widest integer allowed; REAL64 always passes */
    unsigned options; /* plcHasL | ...: options that mean something here; others
                         are accepted and ignored, as s7plc does */
    const char *defaultType; /* "INT16", "STRING" */
} plcShape;

/* Fills in the defaults (type, L, H) and checks type, limits and bit against the shape.
 * `length` is the number of bytes of the record's own string or array, the default L of
 * T=STRING (0: none); a longer L is kept as given. Returns as plcLinkParse, with a
 * warning of its own: that of plcLinkParse is overwritten.
 *
 * L and H are taken exactly as given, but H without L means L=0, and L=0 H=0 the limits
 * of the type, as with s7plc. L may be below the type, with a warning: it is a point of
 * the LINEAR scale then, and what is written must be cut to the type by the caller. */
int plcLinkComplete(plcLink *link, const plcShape *shape, size_t length,
                    plcLinkError *error);

/* Options that stand in the text (`given`, as parsed) and do nothing for the record type, and a + of
 * the offset with nothing behind it: s7plc takes them, and macros leave 0 and nothing. A warning in
 * *error, or "". */
void plcLinkIdle(const plcLink *given, const plcType *type, const plcShape *shape,
                 plcLinkError *error);

/* The order of the bytes (plcCodec.h) at a completed link, where `order` and `textOrder` are those
 * of the station: W= wins; types of 1 and 2 bytes have no order of words. */
int plcLinkOrder(const plcLink *link, int order, int textOrder);

/* *length bytes are what there is of a text in this order (plcTextABCD, ...). What is no whole number
 * of its units is left out; where L= says so, it is refused. Returns 0 or -1. */
int plcLinkTextLength(const plcLink *link, int order, size_t *length, plcLinkError *error);

#endif /* INC_plcLink_H */

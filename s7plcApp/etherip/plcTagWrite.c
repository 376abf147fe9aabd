/* plcTag: how it writes a tag; see plcTag.h. The tag is read first: its type is needed. */
#include <stdarg.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>

#include "plcTag.h"

/* What the messages of this file need: put into w. All return 0, or -1 with c->why. */
static int refuse(eipClient *c, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);

static int refuse(eipClient *c, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    epicsVsnprintf(c->why, sizeof(c->why), format, args);
    va_end(args);
    return -1;
}

static int isNumber(const char *text, const char *type)
{
    eipNumber number;

    return eipNumberParse(eipTypeNamed(type), text, &number) == 0;
}

static int refuseNumber(eipClient *c, const char *text, const eipType *type)
{
    unsigned bits = 8 * type->size - (type->kind == eipSigned);
    epicsUInt64 high = ~(epicsUInt64)0 >> (64 - bits);

    if (type->kind == eipReal && isNumber(text, "REAL"))
        return refuse(c, "\"%.60s\" does not fit %s: it is too large", text, type->name);
    if (type->kind == eipReal)
        return refuse(c, "\"%.60s\" does not fit %s; allowed: a number", text, type->name);
    if (type->code == eipBool)
        return refuse(c, "\"%.60s\" does not fit %s; allowed: 0, 1, false, true", text, type->name);
    return refuse(c, "\"%.60s\" does not fit %s; allowed: %s%lld to %llu", text, type->name,
                  isNumber(text, "LINT") || isNumber(text, "ULINT") ? "" : "whole numbers, ",
                  type->kind == eipSigned ? -(long long)high - 1 : 0, (unsigned long long)high);
}

/* --- Bits ------------------------------------------------------------------------------------- */

static int bitOf(const char *text)
{
    eipNumber number;

    return eipNumberParse(eipTypeOf(eipBool), text, &number) ? -1 : (int)number.u.integer;
}

/* A controller that has no read-modify-write: the element that was read, with its new bit. */
static int writeElement(eipClient *c, const eipValue *v, const eipType *type, epicsUInt64 bit, int on)
{
    epicsUInt64 value = eipGetUnsigned(v->bytes, type->size);
    eipWriter w = eipClientWriter(c);

    eipValuePath(&w, &v->name, eipWriteTag);
    eipPut16(&w, type->code);
    eipPut16(&w, 1);
    eipPutUnsigned(&w, type->size, on ? value | bit : value & ~bit);
    return eipClientTell(c, &w);
}

static int writeBit(eipClient *c, const eipValue *v, const eipType *type, const char *text)
{
    epicsUInt64 bit = (epicsUInt64)1 << v->name.bit, on;
    eipWriter w = eipClientWriter(c);
    eipAnswer answer;
    int value = bitOf(text);

    if (value < 0)
        return refuse(c, "\"%.60s\" does not fit a bit; allowed: 0 or 1, false or true", text);
    on = value ? bit : 0;
    eipValuePath(&w, &v->name, eipReadModifyWrite);
    eipPut16(&w, type->size);
    eipPutUnsigned(&w, type->size, on);
    eipPutUnsigned(&w, type->size, on | ~bit);
    if (eipClientAsk(c, &w, &answer))
        return -1;
    if (answer.status == eipNoService)
        return writeElement(c, v, type, bit, value);
    if (answer.status)
        eipClientExplain(c, &v->name, 1, &answer);
    return answer.status ? -1 : 0;
}

/* --- Texts and numbers ------------------------------------------------------------------------ */

static int putText(eipClient *c, eipWriter *w, const eipValue *v, const char *text)
{
    epicsUInt8 raw[70000];
    size_t length = v->data.code == eipStructureCode ? v->data.length : strlen(text) + 2;

    length = length > sizeof(raw) ? 0
                                  : eipTextPut(v->data.code, raw, length,
                                               v->characters, text, strlen(text));
    if (!length && v->characters)
        return refuse(c, "\"%.60s\" does not fit the string: it has %u characters, allowed: %u", text,
                      (unsigned)strlen(text), v->characters);
    if (!length)
        return refuse(c, "\"%.60s\" does not fit the string", text);
    eipValuePath(w, &v->name, eipWriteTag);
    eipPut16(w, v->data.code);
    if (v->data.code == eipStructureCode)
        eipPut16(w, v->data.handle);
    eipPut16(w, 1);
    eipPutBytes(w, raw, length);
    return 0;
}

static int putNumbers(eipClient *c, eipWriter *w, eipValue *v, const eipType *type, char **words,
                      int count)
{
    int i;

    eipValueFirst(c, v, (unsigned)count);
    eipValuePath(w, &v->name, eipWriteTag);
    eipPut16(w, type->code);
    eipPut16(w, (unsigned)count);
    for (i = 0; i < count; i++) {
        epicsUInt8 raw[8];
        eipNumber number;

        if (eipNumberParse(type, words[i], &number) || eipNumberPut(type, raw, &number))
            return refuseNumber(c, words[i], type);
        eipPutBytes(w, raw, type->size);
    }
    if (c->connect.identity.vendor == eipVendorOmron && type->code == eipBool && count == 1)
        eipPut8(w, 0); /* is it forced? */
    if (w->full || w->n > c->connect.room)
        return refuse(c, "%d values do not fit one message of %u bytes; allowed: fewer at a time", count,
                      c->connect.room);
    return 0;
}

static int writeValue(eipClient *c, eipValue *v, char **words, int count)
{
    const eipType *type = eipTypeOf(v->data.code);
    eipWriter w = eipClientWriter(c);
    eipAnswer answer;

    if (v->data.code == eipStructureCode && !v->characters)
        return refuse(c, "\"%.60s\" does not fit a structure; its members can be written", words[0]);
    if (count > 1 && (v->name.bit >= 0 || !type->size))
        return refuse(c, "several values for %s; allowed: one%s", v->name.bit >= 0 ? "a bit" : "a string",
                      v->name.bit >= 0 ? "" : ", in quotes where it has blanks");
    if (v->name.bit >= 0 && type->code != eipBool)
        return writeBit(c, v, type, words[0]);
    if (type->size ? putNumbers(c, &w, v, type, words, count) : putText(c, &w, v, words[0]))
        return -1;
    if (eipClientAsk(c, &w, &answer))
        return -1;
    if (answer.status)
        eipClientExplain(c, &v->name, (unsigned)count, &answer);
    return answer.status ? -1 : 0;
}

int plcTagWrite(eipClient *c, const char *tag, char **words, int count)
{
    eipValue v;
    int status;

    if (eipValueInit(c, &v, tag))
        return -1;
    status = eipClientRead(c, &v, 1);
    if (!status)
        status = writeValue(c, &v, words, count);
    eipValueFree(&v);
    return status;
}

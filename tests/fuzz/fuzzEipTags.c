/* Fuzz target: what a PLC tells of its tags over EtherNet/IP: the list, templates, types, values.
 * Nothing is stored outside the place of a tag, and what is asked fits what was reckoned. */
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsString.h>

#include "eipTags.h"
#include "fuzz.h"

fuzzTarget fuzzEipTags;

enum { imageSize = 4096, wantsMost = 24 };

static const char *const names[] = {
    "DINTs", "REALs", "Motor.Speed", "Motor.On", "Motor.Ready", "Motor.Name", "Motor.Sub.A",
    "Motor.Sub.B", "Motor.Sub.C", "Text", "M[1].x", "M[1].y", "M[1].z", "Program:Main.v",
};

/* Wishes for some of the names, each with a place of its own. */
static unsigned wish(fuzzBytes *b, eipWant **wants)
{
    unsigned n = fuzzTake(b) % wantsMost, i;
    size_t place = 0;

    *wants = calloc(n + 1, sizeof(**wants));
    for (i = 0; i < n; i++) {
        eipWant *w = &(*wants)[i];
        unsigned how = fuzzTake(b);

        w->tag = epicsStrDup(names[how % (sizeof(names) / sizeof(names[0]))]);
        w->index = fuzzTake(b) % 8 == 7 ? 0xffffffffu - how : how / 16;
        w->kind = (eipPlaceKind)(fuzzTake(b) % 3);
        w->count = w->kind == eipArrayPlace ? 1 + fuzzTake(b) % 12 : 1;
        w->alone = how % 17 == 0;
        w->indexed = how % 19 == 0;
        w->period = 100;
        w->place = place;
        w->room = w->kind == eipCell ? eipCellSize : eipPlaceHead + 8u * w->count + 20;
        w->refused = how % 23 == 0;
        place += w->room;
    }
    fuzzCheck(place <= imageSize);
    return n;
}

/* The list, as one answer after the other. */
static void listed(eipTags *t, fuzzBytes *b)
{
    size_t length;
    epicsUInt8 *answer = fuzzTakeMessage(b, &length);
    eipReader r = eipReaderOf(answer, length);
    eipSymbol symbol;

    while (eipSymbolTake(&r, &symbol) > 0) {
        fuzzCheck(strlen(symbol.name) <= eipSymbolNameMax);
        (void)eipSymbolElements(&symbol);
        if (eipSymbolCounts(&symbol))
            eipTagsListed(t, &symbol, symbol.id & 1 ? "Program:Main" : NULL);
    }
    free(answer);
}

/* A template: its sizes, then its definition. */
static void template(eipTags *t, fuzzBytes *b)
{
    size_t length;
    unsigned id = fuzzTake16(b) % eipTemplatesMax;
    epicsUInt8 *sizes = fuzzTakeMessage(b, &length), *definition;
    eipAnswer answer = {.data = sizes, .length = length};
    eipTemplate *one = calloc(1, sizeof(*one));
    int wrong = eipTemplateSizeTake(&answer, id, one);

    free(sizes);
    definition = fuzzTakeMessage(b, &length);
    if (!wrong) {
        fuzzCheck(eipTemplateBytes(one) <= 1u << 20);
        wrong = eipTemplateParse(one, definition, length);
    }
    free(definition);
    if (wrong || t->templates->table[id]) {
        eipTemplateFree(one);
        free(one);
        return;
    }
    fuzzCheck(eipTemplateIsString(one) <= 65535);
    fuzzCheck(!eipTemplateIsString(one) ||
              eipTemplateIsString(one) + eipStringData <= one->size);
    t->templates->table[id] = one;
}

static void learned(eipTags *t, fuzzBytes *b)
{
    size_t length;
    unsigned tag = fuzzTake(b), status = fuzzTake(b);
    epicsUInt8 *data = fuzzTakeMessage(b, &length);
    eipAnswer answer = {.service = eipReadTag, .status = status & 0x80 ? status & 0x7f : 0,
                        .extended = status, .data = data, .length = length};

    if (t->tagCount) {
        eipTag *one = &t->tags[tag % t->tagCount];

        eipTagLearn(t, one, &answer);
        fuzzCheck(one->state != eipTagNew && strlen(one->reason) < sizeof(one->reason));
        fuzzCheck(one->state != eipTagKnown || one->size > 0);
    }
    free(data);
}

static void ask(const eipTags *t, const eipUnit *u)
{
    epicsUInt8 *bytes = malloc(4000);
    eipWriter w = eipWriterOf(bytes, 4000);
    int byInstance;

    for (byInstance = 0; byInstance < 2; byInstance++) {
        eipLoad load = eipUnitLoad(t, u, byInstance);

        w.n = 0;
        eipUnitPut(&w, t, u, byInstance, -1);
        fuzzCheck(!w.full && w.n == load.request && load.answer >= eipAnswerHead);
        eipUnitPut(&w, t, u, byInstance, 12345);
    }
    free(bytes);
}

/* Data for a unit: only the places of its pieces change. */
static void values(const eipTags *t, fuzzBytes *b)
{
    size_t length, at;
    epicsUInt8 *bytes = fuzzTakeMessage(b, &length);
    eipAnswer answer = {.data = bytes, .length = length};
    epicsUInt8 *image = malloc(imageSize);
    eipData data;
    unsigned unit = fuzzTake(b), i;

    memset(image, 0xee, imageSize);
    if (t->unitCount && eipDataTake(&answer, &data) == 0) {
        const eipUnit *u = &t->units[unit % t->unitCount];

        ask(t, u);
        for (i = 0; i < u->pieces; i++) {
            const eipPiece *p = &t->pieces[u->from + i];
            const eipWant *w = &t->wants[p->want];
            const char *why = eipPieceStore(t, p, data.bytes, data.length, image);

            fuzzCheck(!why || (why[0] && strlen(why) < eipReasonSize));
            for (at = 0; at < imageSize; at++)
                fuzzCheck((at >= w->place && at < w->place + w->room) || image[at] == 0xee);
            memset(image, 0xee, imageSize);
        }
    }
    free(image);
    free(bytes);
}

static void find(const eipTags *t, fuzzBytes *b)
{
    static const char *const paths[] = {"Speed", "Sub.A", "Sub.Sub.Sub.A", "x[3].y", "On", "Name"};
    unsigned id = fuzzTake16(b) % eipTemplatesMax;
    const char *path = paths[fuzzTake(b) % 6];
    eipMemberPlace place = {0};
    int found = eipMemberFind(t->templates, id, path, &place);

    fuzzCheck(found >= -1 && found < eipTemplatesMax);
    fuzzCheck(found || (place.size && place.bit >= -1 && place.bit < 8));
}

int fuzzEipTags(const epicsUInt8 *data, size_t size)
{
    fuzzBytes b = {data, size};
    eipTags t;
    eipWant *wants;
    unsigned n = wish(&b, &wants), i, k;

    eipTagsInit(&t);
    t.omron = (int)(size & 1);
    eipTagsSet(&t, wants, n);
    while (b.left) {
        switch (fuzzTake(&b) % 10) {
        case 0:
            listed(&t, &b);
            break;
        case 1:
        case 2:
            template(&t, &b);
            break;
        case 3:
        case 4:
            learned(&t, &b);
            break;
        case 5:
            eipUnitsMake(&t);
            for (i = 0; i < t.unitCount; i++)
                for (k = 0; k < t.units[i].pieces; k++)
                    fuzzCheck(t.pieces[t.units[i].from + k].want < t.wantCount);
            break;
        case 6:
            if (t.unitCount)
                eipUnitSplit(&t, fuzzTake(&b) % t.unitCount);
            break;
        case 7:
            find(&t, &b);
            break;
        default:
            values(&t, &b);
        }
    }
    eipTagsFree(&t);
    return 0;
}

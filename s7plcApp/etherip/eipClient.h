/* A session for people: reads a tag, lists tags, describes types, one after the other, on a
 * connection of its own.
 *
 * It waits for the PLC: not for a thread of an IOC that has other duties. Functions return 0,
 * or -1 with the reason in client->why.
 */
#ifndef INC_eipClient_H
#define INC_eipClient_H

#include <stdio.h>

#include "eipConnect.h"
#include "eipSocket.h"
#include "eipTags.h"

enum {
    eipClientMessageMax = 65000,
    eipClientValueMax = 1 << 20, /* bytes of one value */
    eipClientTagsMax = 100000, /* in one list */
    eipClientNameMax = 2 * eipSymbolNameMax + 2
};

typedef struct eipClient {
    eipSocket socket;
    eipConnect connect;
    unsigned timeout; /* ms, for each answer */
    eipTemplates templates;
    epicsUInt8 *frame, *message;
    char why[300];
    char host[300];
    int lost; /* no answer, or none that counts: eipClientReopen makes a new connection */
} eipClient;

/* NULL: no memory. */
eipClient *eipClientCreate(const eipConnectOptions *connect, unsigned timeout);
void eipClientDestroy(eipClient *c);

/* `host` is host[:port]. CheckHost looks how it is written, and nothing up. */
int eipClientCheckHost(eipClient *c, const char *host);
int eipClientOpen(eipClient *c, const char *host);
void eipClientClose(eipClient *c);

/* Connects to the same host anew; what was known of types is forgotten. */
int eipClientReopen(eipClient *c);

/* Says why: it stands in client->why. */
void eipClientWhy(eipClient *c, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);

/* The same, and is -1, which checkers of code do not see through variable arguments. */
#define eipClientFail(c, ...) (eipClientWhy(c, __VA_ARGS__), -1)

/* A message for eipClientAsk is put there. */
eipWriter eipClientWriter(eipClient *c);
int eipClientAsk(eipClient *c, eipWriter *w, eipAnswer *answer);

/* The same; a status other than success is a reason, too. */
int eipClientTell(eipClient *c, eipWriter *w);

/* A value as it was read. */
typedef struct eipValue {
    eipName name;
    eipData data; /* its bytes lie in `bytes` */
    unsigned characters; /* that a string has room for; 0: it is none, or is not known */
    const eipTemplate *structure; /* of the client; NULL: it is none, or is not known */
    epicsUInt8 *bytes; /* of eipClientValueMax */
} eipValue;

int eipValueInit(eipClient *c, eipValue *value, const char *tag);
void eipValueFree(eipValue *value);

/* Puts path and service for it. */
void eipValuePath(eipWriter *w, const eipName *name, int service);

/* Omron: several elements begin at one that is named. */
void eipValueFirst(const eipClient *c, eipValue *value, unsigned count);

/* Reads `count` elements, in as many parts as it takes. */
int eipClientRead(eipClient *c, eipValue *value, unsigned count);

/* One element was read, by a name without an index: does the PLC have more? */
int eipClientHasMore(eipClient *c, const eipValue *value);

/* "1 2 3", "\"text\"" or "{Speed=1 Name="M"}", without a line end. */
void eipValuePrint(eipClient *c, const eipValue *value, FILE *file);

typedef void eipSymbolVisit(eipClient *c, const char *name, const eipSymbol *symbol, void *arg);

/* All tags of the controller, and those of its programs with "Program:x." before them. */
int eipClientList(eipClient *c, eipSymbolVisit *visit, void *arg);

/* Prints those whose name matches the pattern (NULL: all), with their types. */
int eipClientPrintList(eipClient *c, const char *pattern, FILE *file);

/* The type of a tag or member without its last index, as it is listed, and its dimensions.
 * eipNoList: the PLC has no list, or the connection is lost; eipNoTag: it is not in it. */
typedef enum { eipTypeFound, eipNoList, eipNoTag } eipClientFound;
eipClientFound eipClientTypeOf(eipClient *c, const char *base, unsigned *type,
                               epicsUInt32 dimension[3]);

/* "DINT[10]", "Motor" */
const char *eipClientTypeText(eipClient *c, unsigned type, const epicsUInt32 *dimension, char *text,
                              size_t size);

/* Puts into client->why what was wrong with a tag of which `count` elements were refused. */
void eipClientExplain(eipClient *c, const eipName *name, unsigned count, const eipAnswer *answer);

/* The template of this id, from the PLC the first time; NULL: it has none. */
const eipTemplate *eipClientTemplate(eipClient *c, unsigned id);

/* Prints a template, or the type of a tag or member (or of a structure, by its name) with that of
 * its members. */
int eipClientPrintTemplate(eipClient *c, unsigned id, FILE *file);
int eipClientDescribe(eipClient *c, const char *tag, FILE *file);

#endif /* INC_eipClient_H */

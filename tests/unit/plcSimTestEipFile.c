/* plcSimTestEipFile: the simulator's tags and structures from its file, what each error
 * says, and their values as text.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcSimBuilt.h"
#include "simEipServer.h"
#include "simEipValue.h"

static simLoop loop;
static plcSimBuilt built;
static simEipController *c; /* of its server */

static int build(const char *text)
{
    int errors = plcSimBuild(&built, &loop, text);
    simEipServer *server = simPlcServerOf(&built.plc, &simEipServerType);

    c = &server->eip.controller;
    return errors;
}

static void dismantle(void)
{
    plcSimDismantle(&built);
}

/* ---- the file ---- */

#define ON "port = off\nbyteorder = little\netherip_port = 0\n"

/* clang-format off */
static const struct {
    const char *what, *text, *message;
} bad[] = {
    {"a port that is too large", "etherip_port = 65536",
     "etherip_port = 65536: allowed is off or a number 0 ... 65535"},
    {"an unknown profile", "etherip_profile = s7",
     "allowed is l8x|enet|micro800|omron"},
    {"tags without a port", "byteorder = little\ntag A DINT", "but etherip_port = off"},
    {"a big-endian PLC", "etherip_port = 0", "needs byteorder = little"},
    {"a pair", "byteorder = little\netherip_port = 0\nrole = pair",
     "etherip_port needs role = single"},
    {"a tag without type", ON "tag A", "t.plc:4: tag wants: <name> <type>"},
    {"a type that is not there", ON "tag A FOO", "\"FOO\" is no type"},
    {"a name with a blank", ON "tag \"A B\" DINT", "is no name of a tag"},
    {"a name that begins with a digit", ON "tag 1A DINT", "is no name of a tag"},
    {"a name of 41 characters",
     ON "tag A2345678901234567890123456789012345678901 DINT", "is no name of a tag"},
    {"a program without a tag", ON "tag Program:Main DINT", "is no name of a tag"},
    {"a member as tag", ON "tag A.b DINT", "is no name of a tag"},
    {"a name twice, in other letters", ON "tag Abc DINT\ntag aBC INT",
     "t.plc:5: there is a tag aBC already"},
    {"a dimension of 0", ON "tag A DINT[0]", "dimensions are [n]"},
    {"four dimensions", ON "tag A DINT[2,2,2,2]", "dimensions are [n]"},
    {"a bracket that is open", ON "tag A DINT[2", "dimensions are [n]"},
    {"too many elements", ON "tag A DINT[2000,2000]", "more than 2000000 elements"},
    {"33 BOOLs", ON "tag A BOOL[33]", "a multiple of 32"},
    {"no address", ON "tag A DINT ->", "an address is missing"},
    {"an address in no block", ON "tag A DINT -> DB10.0", "no block \"DB10\""},
    {"a tag that goes beyond its block", ON "db 10 10\ntag A DINT[3] -> DB10.0",
     "12 bytes from DB10.0 on are outside of DB10, which has 10 bytes"},
    {"a value that does not fit", ON "tag A SINT = 128", "128 does not fit into INT8"},
    {"two values for three", ON "tag A INT[3] = 1 2", "2 value(s) given, but 1 or 3"},
    {"a text that is too long", ON "udt S string 3\ntag A S = abcd",
     "4 characters, but S has 3"},
    {"a value for a structure", ON "udt U x:INT\ntag A U = 5", "set its members"},
    {"a signal for a string", ON "tag A STRING counter", "no signals for STRING"},
    {"an unknown signal", ON "tag A DINT sin", "\"sin\" is not known"},
    {"a structure without members", ON "udt U", "udt wants: <name> <member>:<type>"},
    {"a member without type", ON "udt U x", "a member is <name>:<type>"},
    {"a member of no type", ON "udt U x:FOO", "\"FOO\" is no type"},
    {"a member twice", ON "udt U x:INT X:DINT", "two members X"},
    {"a structure twice", ON "udt U x:INT\nudt u y:INT", "there is a type u already"},
    {"an elementary type anew", ON "udt DINT x:INT", "there is a type DINT already"},
    {"a string of no characters", ON "udt S string 0", "<characters 1 ... 65535>"},
};
/* clang-format on */

static void testBad(void)
{
    size_t i;

    for (i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        int errors = build(bad[i].text);

        testOk(errors >= 1 && built.messages.text && strstr(built.messages.text, bad[i].message),
               "%s: %.*s", bad[i].what,
               built.messages.text ? (int)strcspn(built.messages.text, "\n") : 4,
               built.messages.text ? built.messages.text : "none");
        dismantle();
    }
}

/* ---- values as text ---- */

static const char plant[] = ON "udt Pair A:INT Ok:BOOL Fine:BOOL\n"
                               "tag I INT[10] = 1 2 3 4 5 6 7 8 9 10\n"
                               "tag T STRING = ab\n"
                               "tag P Pair[2]\n"
                               "tag X DINT[2,3] = 0 1 2 10 11 12\n"
                               "tag Program:Main.Z SINT = -1\n"
                               "tag Wait TIMER\n";

static int shows(const char *tag, const char *value)
{
    char error[SIM_ERROR_SIZE];
    simText text = {NULL, 0, 0};
    simEipPlace place;
    int same = 0;

    if (!simEipTagsPlace(&c->tags, tag, &place, error)) {
        simEipValueGet(&place, &text);
        same = !strcmp(text.text, value);
    }
    if (!same)
        testDiag("%s is %s", tag, text.text ? text.text : error);
    simTextFree(&text);
    return same;
}

static int takes(const char *tag, char *word)
{
    char error[SIM_ERROR_SIZE];
    simEipPlace place;

    return !simEipTagsPlace(&c->tags, tag, &place, error) &&
           !simEipValueSet(&place, &word, 1, error);
}

/* Several values at once: nothing is written when one of them is wrong. */
static int takesAll(const char *tag, const char *line)
{
    char error[SIM_ERROR_SIZE], text[100];
    char *words[20];
    simEipPlace place;
    int count;

    strcpy(text, line);
    count = simSplit(text, words, 20, error);
    return !simEipTagsPlace(&c->tags, tag, &place, error) &&
           !simEipValueSet(&place, words, (size_t)count, error);
}

static void testValues(void)
{
    char one[] = "1", three[] = "3", text[] = "a\"b", large[] = "40000";

    build(plant);
    testOk(shows("X", "0 1 2 10 11 12"), "a whole array");
    testOk(takes("X[1,2]", three) && shows("X[1,2]", "3"), "one element");
    testOk(!takesAll("X", "1 2 3 4 5 six") && shows("X", "0 1 2 10 11 3"),
           "nothing of values that are not all good");
    testOk(takesAll("X[1,0]", "8 9") && shows("X", "0 1 2 8 9 3"),
           "some, from an element on");
    testOk(takes("p[1].a", three) && shows("P[1]", "{A=3 Ok=0 Fine=0}"), "a member");
    testOk(takes("T", text) && shows("T", "\"a\\x22b\""), "a string");
    testOk(!takes("I[0]", large) && shows("I[0]", "1"), "no value that does not fit");
    testOk(takes("Wait.DN", one) && shows("Wait", "{PRE=0 ACC=0 EN=0 TT=0 DN=1}") &&
               shows("Wait.CTL", "536870912"),
           "DN of a TIMER is bit 29 of its first word");
    testOk(!takes("I[10]", three), "no element that is not there");
    testOk(!takes("Program:Main.Q", three) && takes("Program:Main.Z", three),
           "a program");
    dismantle();
}

MAIN(plcSimTestEipFile)
{
    testPlan(34 + 10);
    testBad();
    testValues();
    return testDone();
}

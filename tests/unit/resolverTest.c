/* Host names become addresses while nobody waits. */
#include <string.h>

#include <arpa/inet.h>

#include <epicsAtomic.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcResolver.h"
#include "testTools.h"

static int woken;

static void wake(void *arg)
{
    epicsAtomicIncrIntT((int *)arg);
}

static const struct {
    const char *address;
    unsigned plus;
    const char *result; /* NULL: refused */
} sums[] = {
    {"192.168.0.10", 0, "192.168.0.10"}, {"192.168.0.10", 1, "192.168.0.11"},
    {"192.168.0.253", 1, "192.168.0.254"}, {"192.168.0.254", 1, NULL},
    {"192.168.0.255", 1, NULL},            {"192.168.0.0", 1, "192.168.0.1"},
    {"192.168.0.255", 0, "192.168.0.255"}, {"255.255.255.255", 1, NULL},
    {"10.0.0.1", 253, "10.0.0.254"},       {"10.0.0.1", 254, NULL},
};

static void testSums(void)
{
    size_t i;

    for (i = 0; i < sizeof(sums) / sizeof(sums[0]); i++) {
        struct in_addr address;
        char text[20];
        int status;

        inet_pton(AF_INET, sums[i].address, &address);
        status = plcAddressPlus(&address, sums[i].plus);
        inet_ntop(AF_INET, &address, text, sizeof(text));
        testOk(status == (sums[i].result ? 0 : -1) &&
                   strcmp(text, sums[i].result ? sums[i].result : sums[i].address) == 0,
               "%s+%u is %s", sums[i].address, sums[i].plus,
               sums[i].result ? sums[i].result : "refused");
    }
}

static void testHosts(void)
{
    static const struct {
        const char *host;
        int good;
    } rows[] = {
        {"192.168.0.1", 1},     {"0.0.0.0", 1},     {"plc-1", 1},         {"plc_1.site.org", 1},
        {"1st.plc", 1},         {"abc.de", 1},      {"", 1},              {"192.168.1", 0},
        {"10.1", 0},            {"10", 0},          {"3232235777", 0},    {"1.2.3.4.5", 0},
        {"1.2.3.256", 0},       {"0300.1.1.1", 0},  {"192.168.000.1", 0}, {"192.168.0.1.", 0},
        {".168.0.1", 0},        {"192..0.1", 0},    {"0xC0A80001", 0},    {"0xC0.0xA8.1", 0},
        {"192.168.0.0x1", 0},   {"two words", 0},   {"plc/1", 0},         {"192.168.0.1:2000", 0},
        {" 192.168.0.1", 0},    {"::1", 0},
    };
    char longest[257];
    size_t i;

    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++)
        testOk(plcAddressIsHost(rows[i].host) == rows[i].good, "\"%s\" is %s", rows[i].host,
               rows[i].good ? "taken" : "refused");
    memset(longest, 'h', sizeof(longest));
    longest[256] = 0;
    testOk(!plcAddressIsHost(longest), "a name of 256 characters is refused");
    longest[255] = 0;
    testOk(plcAddressIsHost(longest), "one of 255 is taken");
}

static void testDotted(void)
{
    struct in_addr address = {0};
    char error[80] = "";
    plcResolver *r = plcResolverCreate("127.0.0.1", 1, wake, &woken);

    testOk(plcResolverAddress(r, 1, &address, error, sizeof(error)) == 1 &&
               address.s_addr == htonl(0x7F000002),
           "a dotted address is known at once, with its +1");
    plcResolverRelease(r);
    r = plcResolverCreate("127.0.0.254", 1, wake, &woken);
    testOk(plcResolverAddress(r, 1, &address, error, sizeof(error)) == -1 &&
               strstr(error, "127.0.0.254+1"),
           "one that has no +1: %s", error);
    plcResolverRelease(r);
    testOk(epicsAtomicGetIntT(&woken) == 0, "no look-up was needed");
    plcResolverRelease(NULL);
}

static int known(plcResolver *r, struct in_addr *address, char *error, size_t size)
{
    return plcResolverAddress(r, 0, address, error, size);
}

static void testName(void)
{
    struct in_addr address = {0};
    char error[80] = "";
    plcResolver *r = plcResolverCreate("localhost", 0, wake, &woken);
    int first = plcResolverAddress(r, 1, &address, error, sizeof(error));

    testOk(first >= 0, "the first question starts a look-up, and no error");
    WAIT_FOR(epicsAtomicGetIntT(&woken) > 0);
    testOk(epicsAtomicGetIntT(&woken) == 1, "news wake the owner");
    testOk(known(r, &address, error, sizeof(error)) == 1 &&
               ntohl(address.s_addr) >> 24 == 127,
           "localhost is 127.x");
    testOk(plcResolverAddress(r, 1, &address, error, sizeof(error)) == 1,
           "a refresh answers with the last address meanwhile");
    WAIT_FOR(epicsAtomicGetIntT(&woken) > 1);
    plcResolverRelease(r);
}

static void testUnknown(void)
{
    struct in_addr address = {0};
    char error[80] = "";
    plcResolver *r;

    epicsAtomicSetIntT(&woken, 0);
    r = plcResolverCreate("no-such-plc.invalid", 0, wake, &woken);
    plcResolverAddress(r, 1, &address, error, sizeof(error));
    WAIT_FOR(epicsAtomicGetIntT(&woken) > 0);
    testOk(known(r, &address, error, sizeof(error)) == -1 &&
               strcmp(error, "no address for host \"no-such-plc.invalid\"") == 0,
           "an unknown name: %s", error);
    plcResolverRelease(r);
    /* 255 characters are no valid name: an error, not a crash */
    {
        char host[256];

        memset(host, 'x', 255);
        host[255] = 0;
        r = plcResolverCreate(host, 0, wake, &woken);
        epicsAtomicSetIntT(&woken, 0);
        plcResolverAddress(r, 1, &address, error, sizeof(error));
        WAIT_FOR(epicsAtomicGetIntT(&woken) > 0);
        testOk(known(r, &address, error, sizeof(error)) == -1, "255 characters: an error");
        plcResolverRelease(r);
    }
}

/* Many owners go away while their look-ups run: those clean up after themselves (the
 * sanitizers watch), and nobody is woken afterwards. */
static void testRelease(void)
{
    struct in_addr address;
    char error[80];
    int i, last = 0;

    for (i = 0; i < 20; i++) {
        int mine = 0;
        plcResolver *r = plcResolverCreate(i & 1 ? "localhost" : "no-such-plc.invalid", 0,
                                           wake, &mine);

        plcResolverAddress(r, 1, &address, error, sizeof(error));
        plcResolverRelease(r);
        last = epicsAtomicGetIntT(&mine);
    }
    testOk(last <= 1, "look-ups outlive their owners");
    {
        plcResolver *r = plcResolverCreate("localhost", 0, wake, &woken);

        epicsAtomicSetIntT(&woken, 0);
        plcResolverAddress(r, 1, &address, error, sizeof(error));
        WAIT_FOR(epicsAtomicGetIntT(&woken) > 0);
        testOk(epicsAtomicGetIntT(&woken) == 1, "and others work on");
        plcResolverRelease(r);
    }
}

MAIN(resolverTest)
{
    testPlan((int)(sizeof(sums) / sizeof(sums[0])) + 39);
    testSums();
    testHosts();
    testDotted();
    testName();
    testUnknown();
    testRelease();
    return testDone();
}

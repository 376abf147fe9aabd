/* Roles of a redundant pair: a table of stories, then every short story there is.
 *
 * A story is words with times in ms:
 *   1@t 2@t      a block of FIRST, of SECOND      .@t  time goes on (ticks as asked for)
 *   -1@t -2@t    its connection is lost           +1@t +2@t  is up
 * and what must be true at that point:
 *   F S N        FIRST, SECOND, nobody leads      T t  two PRIMARIES, or not
 *   #n           n switch-overs                   :n   the last one took n ms
 *   ?s ?d ?o     because the old one was silent, disconnected, timed out
 *   M m          its first block has missed more than two of its blocks, or not
 */
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "pairRole.h"

#define MS 1000000ull
#define START (1000 * MS) /* time 0 of the stories */

/* FIRST leads, then both send */
#define BOTH "1@0 1@100 1@200 2@210 1@300 2@310 1@400 2@410 1@500 2@510 "

static const struct {
    const char *sentence;
    const char *story;
} stories[] = {
  /* who sends is PRIMARY */
    {"nobody leads before the first block",                                             "N +1@0 N +2@5 N .@5000 N #0"               },
    {"the first block makes its sender the PRIMARY",                                    "+1@0 +2@0 2@10 S #0"                       },
    {"it need not be FIRST, and the connection of the other does not matter",
     "+2@0 2@10 S +1@20 S 2@110 S -1@120 S #0"                                                                                      },
    {"the PRIMARY leads on while it sends",                                             "1@0 1@100 1@200 1@300 1@400 F .@450 F #0 t"},
 /* switch-over */
    {"PRIMARY silent for a while, then the other sends: it leads with its first block",
     "1@0 1@100 1@200 2@700 F .@700 S #1 :500 ?s"                                                                                   },
    {"orderly switch-over: the other leads when the next block of the old is overdue",
     "1@0 1@100 1@200 1@300 2@310 F .@400 F .@406 F .@408 S #1 :107 ?s"                                                             },
    {"orderly switch-over with a block of the new one in between: the same",
     "1@0 1@100 1@200 1@300 2@310 2@350 F .@408 S #1 t"                                                                             },
    {"the new PRIMARY goes on to lead",
     "1@0 1@100 1@200 2@210 .@320 S 2@310 2@410 2@510 2@610 S #1"                                                                   },
    {"there and back again",
     "1@0 1@100 1@200 2@700 .@700 S 2@800 2@900 1@1400 .@1400 F #2 :500"                                                            },
 /* a connection breaks */
    {"connection of the PRIMARY lost, nobody sends: nobody leads",
     "1@0 1@100 -1@120 N .@9000 N #0"                                                                                               },
    {"then the first block of the other makes it the PRIMARY, at once",
     "1@0 1@100 -1@120 N 2@600 S #1 :500 ?d"                                                                                        },
    {"lost while the other has begun to send: it leads at once",
     "1@0 1@100 2@110 F -1@115 S #1 :15 ?d"                                                                                         },
    {"silent until recvTimeout, connection given up: the other leads with its first "
     "block",                                                                                  "1@0 1@100 -1@2100 N 2@2200 S #1 :2100 ?o"                                                                                                                        },
    {"connection of the BACKUP lost: the PRIMARY leads on",
     "1@0 1@100 -2@120 F 1@200 F #0"},
    {"the BACKUP that had begun to send is lost: the PRIMARY leads on, however silent",
     "1@0 1@100 2@110 -2@120 .@900 F #0"                                                                                            },
 /* the same PLC comes back */
    {"the PRIMARY restarts and sends again: no switch-over",
     "1@0 1@100 -1@120 N +1@600 N 1@700 F #0"},
    {"the old PRIMARY comes back as BACKUP: nothing changes",
     "1@0 1@100 -1@120 2@300 S +1@900 S 2@400 S #1"                                                                                           },
    {"who restarts with another period is known by that after a few blocks",
     "1@0 1@10 1@20 1@30 1@40 -1@41 1@900 1@950 1@1000 1@1050 1@1100 1@1150 1@1200 "
     "1@1250 "
     "1@1300 2@1310 .@1350 F .@1355 S"},
 /* the IOC stood still */
    {"an IOC that stood still meanwhile, and finds blocks of both: the other leads soon",
     "1@0 1@100 1@200 1@300 1@400 1@4000 2@4000 F .@4260 F .@4267 S #1 ?s"                                                                  },
    {"many blocks found at once tell nothing of the period: it is known again with the next ones",
     "1@0 1@100 1@200 1@300 1@400 1@500 1@500 1@500 1@500 1@500 1@500 1@500 1@500 1@500 1@600 "
     "1@700 2@710 F .@800 F .@808 S #1"                                                                                                     },
    {"a PLC that has become slower is learned within two blocks",
     "1@0 1@100 1@200 1@300 1@400 1@800 1@1200 1@1600 2@1610 .@2020 F .@2026 S"                                                             },
 /* both send */
    {"two PRIMARIES: the present one stays",                                                                                 "1@0 1@100 1@200 2@210 1@300 F 2@310 1@400 "
     "2@410 1@500 t 2@510 T F 1@600 2@610 T F #0"                                                                                                                            },
    {"two PRIMARIES: a late block of the present one does not matter",
     BOTH "T 2@610 T F 1@680 T F 2@710 1@800 T F #0"},
    {"two PRIMARIES: the other stops, all is well again",
     BOTH "T 1@600 1@700 1@800 T 1@900 t F #0"                                                                                                                         },
    {"two PRIMARIES: the present one stops, the other leads after two missed blocks",
     BOTH "1@600 2@610 2@710 F 2@810 .@810 S t #1"},
    {"two PRIMARIES: the connection of the present one breaks, the other leads at once",
     BOTH "1@600 -1@601 S t #1 ?d"                                                                                                                     },
    {"two PRIMARIES: the connection of the other one breaks, all is well again",
     BOTH "T -2@520 t F 1@600 F #0"},
    {"two PRIMARIES in step, the other always a little earlier: the present one stays",
     "1@0 1@100 1@200 2@199 2@299 1@300 2@399 1@400 2@499 1@500 2@599 1@600 F T #0"                                                                                                                    },
    {"both send from the very start: the first to be heard leads",
     "2@0 1@1 2@100 1@101 2@200 1@201 2@300 1@301 S T #0"},
 /* late blocks of the old PRIMARY */
    {"a block of the old PRIMARY that was on its way: no flapping, no alarm",
     "1@0 1@100 1@200 2@306 .@308 S 1@315 S 2@406 S 2@506 2@606 S t #1"                                                                                                                                              },
    {"several of them at once: the same",
     "1@0 1@100 1@200 2@306 .@308 S 1@315 1@315 1@316 S 2@406 S 2@506 2@606 S t #1"},
    {"a network that holds back what the old PRIMARY sent for one and a half periods",
     "1@0 1@100 1@200 2@210 1@220 2@310 1@320 F 2@410 t .@450 F .@500 S #1 :173 2@510 "
     "2@610 t S"                                                                                                                                  },
    {"minutes later it sends again: new claims, not yet two PRIMARIES",
     "1@0 1@100 1@200 2@306 .@308 S 1@315 2@406 2@506 2@606 2@706 2@806 1@810 S t 2@906 "
     "1@910 2@1006 1@1010 t 2@1106 1@1110 T S #1"},
 /* flapping */
    {"PLCs that hand over at every block are followed one period apart",
     "1@0 1@100 1@200 2@300 .@308 S 2@400 1@500 .@510 F 1@600 2@700 .@710 S #3"                                                                                                 },
 /* little is known yet */
    {"one block ever, then the other sends: half of recvTimeout must pass",
     "1@0 2@10 F 2@900 F .@1001 S #1"},
 /* was there a gap? */
    {"an orderly switch-over misses no block",
     "m 1@0 1@100 1@200 1@300 2@310 .@408 S m"},
    {"one after more than two periods of silence does",
     "1@0 1@100 1@200 2@700 .@700 S #1 :500 M"},
    {"one block late is no gap yet", "1@0 1@100 1@200 2@400 .@400 S :200 m"},
    {"the end of a connection is told in another way", "1@0 1@100 -1@120 N 2@900 S ?d :800 m"},
    {"one block of each: half of recvTimeout must pass", "1@0 2@10 .@999 F .@1000 S #1 :1000 ?s"},
    {"a period is known of the other only: that counts",
     "1@0 2@10 2@60 2@110 .@9000 S #1"                                                                                                                                           },
};

/* --- Stories ------------------------------------------------------------------------ */

typedef struct teller {
    pairRole role;
    epicsUInt64 now, wake;
} teller;

static void tell(teller *t, plcEvent event, unsigned which)
{
    t->wake = 0;
    pairRoleStep(&t->role, event, which, t->now, &t->wake);
}

/* Time goes on to `to`; ticks come when they were asked for, as the station does it. */
static void pass(teller *t, epicsUInt64 to)
{
    while (t->wake && t->wake <= to) {
        if (t->wake > t->now)
            t->now = t->wake;
        tell(t, plcEventTick, 0);
    }
    if (to > t->now)
        t->now = to;
}

static void begin(teller *t)
{
    pairRoleInit(&t->role, 2000 * MS);
    t->now = START;
    t->wake = 0;
}

static int isTrue(const teller *t, const char *word)
{
    static const char reasons[] = {'s', 'o', 'd'};
    const pairRole *r = &t->role;

    switch (word[0]) {
    case 'F':
        return r->leader == pairFirst;
    case 'S':
        return r->leader == pairSecond;
    case 'N':
        return word[1] || r->leader == pairNobody;
    case 'T':
        return r->twoPrimaries;
    case 't':
        return !r->twoPrimaries;
    case '#':
        return r->switchovers == (unsigned)atoi(word + 1);
    case ':':
        return r->duration / MS == (unsigned)atoi(word + 1);
    case '?':
        return reasons[r->reason] == word[1];
    case 'M':
        return pairRoleMissed(r);
    case 'm':
        return !pairRoleMissed(r);
    }
    return 0;
}

/* Tells a story. Returns NULL, or the word that was not true. */
static const char *untrue(const char *story)
{
    static char word[20];
    teller t;
    int length;

    begin(&t);
    for (; *story; story += length + (story[length] == ' ')) {
        const char *at;

        length = (int)strcspn(story, " ");
        sprintf(word, "%.*s", length, story);
        at = strchr(word, '@');
        if (!at) {
            if (!isTrue(&t, word))
                return word;
            continue;
        }
        pass(&t, START + atoi(at + 1) * MS);
        if (word[0] == '-')
            tell(&t, plcEventLost, word[1] - '1');
        else if (word[0] == '+')
            tell(&t, plcEventConnected, word[1] - '1');
        else if (word[0] != '.')
            tell(&t, plcEventBlock, word[0] - '1');
    }
    return NULL;
}

/* --- Every short story -------------------------------------------------------------- */

enum { depth = 7, choices = 7 };

/* One of the things that can happen, from the state *t. */
static void happen(teller *t, int choice)
{
    static const unsigned waits[] = {3, 40, 115};

    if (choice < 2)
        tell(t, plcEventBlock, choice);
    else if (choice < 4)
        tell(t, plcEventLost, choice - 2);
    else
        pass(t, t->now + waits[choice - 4] * MS);
}

/* What must hold between the states before and after one thing that happened. Returns
 * NULL, or the sentence that does not hold. */
static const char *broken(const teller *before, const teller *after, int choice,
                          epicsUInt64 period)
{
    const pairRole *b = &before->role, *a = &after->role;
    int block = choice < 2 ? choice : -1,
        lost = choice >= 2 && choice < 4 ? choice - 2 : -1;
    int changed = a->leader != b->leader;

    if (a->leader != pairNobody && !a->plc[a->leader].lastBlock)
        return "who leads has sent on this connection";
    if (changed && a->leader == pairNobody && lost != (int)b->leader)
        return "nobody leads only when the PRIMARY was lost";
    if (changed && b->leader != pairNobody && a->leader != pairNobody) {
        epicsUInt64 silent = after->now - b->plc[b->leader].lastBlock;

        if (lost != (int)b->leader && silent < period)
            return "a PRIMARY that is not lost and not overdue leads on";
        if (!b->plc[a->leader].claims && !b->twoPrimaries)
            return "only who sends takes over";
    }
    if (b->leader == pairNobody && block >= 0 && a->leader != (pairWho)block)
        return "when nobody leads, the next block decides";
    if (block >= 0 && b->leader == (pairWho)block && changed)
        return "who sends is not replaced";
    if (a->switchovers - b->switchovers !=
        (unsigned)(a->lastLeader != b->lastLeader && b->lastLeader != pairNobody))
        return "each change of the PRIMARY is counted once";
    if (a->twoPrimaries && a->leader == pairNobody)
        return "two PRIMARIES have a leader";
    if (a->leader != pairNobody && a->plc[!a->leader].claims && !after->wake)
        return "a claim waits for a tick";
    if (a->leader != pairNobody && a->plc[a->leader].claims)
        return "who leads claims nothing";
    return NULL;
}

static unsigned long count;

/* All stories of `more` more things, with a PLC that sent every `period` ns at first.
 * Returns NULL, or what did not hold. */
static const char *explore(const teller *t, int more, epicsUInt64 period)
{
    const char *error = NULL;
    int choice;

    for (choice = 0; more && !error && choice < choices; choice++) {
        teller next = *t;

        happen(&next, choice);
        count++;
        error = broken(t, &next, choice, period);
        if (!error)
            error = explore(&next, more - 1, period);
    }
    return error;
}

static void exploreFrom(const char *what, int blocks)
{
    const char *error;
    teller t;
    int i;

    begin(&t);
    tell(&t, plcEventConnected, 0);
    tell(&t, plcEventConnected, 1);
    for (i = 0; i < blocks; i++) {
        tell(&t, plcEventBlock, 0);
        pass(&t, t.now + 100 * MS);
    }
    count = 0;
    error = explore(&t, depth, blocks ? 100 * MS : 3 * MS);
    testOk(!error, "all %lu stories %s keep the rules%s%s", count, what,
           error ? ", but not: " : "", error ? error : "");
}

MAIN(roleTest)
{
    const size_t n = sizeof(stories) / sizeof(stories[0]);
    const char *wrong;
    teller t;
    size_t i;

    testPlan((int)n + 3);
    for (i = 0; i < n; i++) {
        wrong = untrue(stories[i].story);
        testOk(!wrong, "%s%s%s", stories[i].sentence, wrong ? "; not true: " : "",
               wrong ? wrong : "");
    }
    begin(&t);
    t.now += 9000 * MS;
    tell(&t, plcEventTick, 0);
    testOk(t.role.leader == pairNobody && !t.wake, "a tick while nobody leads makes no leader");
    exploreFrom("from the start", 0);
    exploreFrom("after FIRST has led for a while", 9);
    return testDone();
}

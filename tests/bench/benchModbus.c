/* The Modbus/TCP side of the benchmark's PLC; see benchModbus.h.
 *
 * A frame: 0 transaction (2), 2 protocol 0 (2), 4 bytes behind (2), 6 unit, 7 function,
 * 8 first register (2), 10 number (2), and of function 16: 12 bytes of data, 13 the data.
 */
#include <string.h>
#include <sys/socket.h>

#include "benchModbus.h"

#define REGISTERS 2048
#define POLLED 16 /* the first of the registers that are polled; those before are written */
#define FRAME 260 /* bytes, the longest */

static unsigned char memory[2 * REGISTERS];
static unsigned char in[FRAME];
static int fill, polled, changing;

static int word(const unsigned char *at)
{
    return at[0] << 8 | at[1];
}

void modbusBegin(void)
{
    fill = 0;
}

void modbusPolled(int count, int change)
{
    polled = count;
    changing = change;
}

/* A new value in those that change, evenly spread. */
static void change(void)
{
    int i;

    for (i = 0; i < changing; i++) {
        unsigned char *at = memory + 2 * (POLLED + (int)((long)i * polled / changing));

        if (++at[1] == 0)
            at[0]++;
    }
}

/* The answer to the request at `in` behind its header, made in `out`: its length. */
static int answer(unsigned char *out, void (*put)(const unsigned char *))
{
    int function = in[7], start = word(in + 8), count = word(in + 10);

    if (function != 3 && function != 16) {
        out[0] = (unsigned char)(function | 0x80);
        out[1] = 1;
        return 2;
    }
    if (count < 1 || count > (function == 3 ? 125 : 123) || start + count > REGISTERS) {
        out[0] = (unsigned char)(function | 0x80);
        out[1] = 2;
        return 2;
    }
    out[0] = (unsigned char)function;
    if (function == 3) {
        if (start == POLLED)
            change();
        out[1] = (unsigned char)(2 * count);
        memcpy(out + 2, memory + 2 * start, 2 * count);
        return 2 + 2 * count;
    }
    memcpy(memory + 2 * start, in + 13, 2 * count);
    if (start == 0 && count >= 4)
        put(memory);
    memcpy(out + 1, in + 8, 4);
    return 5;
}

int modbusServe(int socket, void (*put)(const unsigned char *bytes))
{
    unsigned char out[FRAME];
    ssize_t n = recv(socket, in + fill, sizeof(in) - fill, MSG_DONTWAIT);
    int size;

    if (n <= 0)
        return -1;
    fill += (int)n;
    while (fill >= 8 && fill >= (size = 6 + word(in + 4))) {
        int length = answer(out + 7, put);

        memcpy(out, in, 7);
        out[4] = 0;
        out[5] = (unsigned char)(length + 1);
        if (send(socket, out, 7 + length, MSG_NOSIGNAL) != 7 + length)
            return -1;
        fill -= size;
        memmove(in, in + size, fill);
    }
    return fill < FRAME ? 0 : -1;
}

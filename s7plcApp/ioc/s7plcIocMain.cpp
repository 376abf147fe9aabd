/* The main program of s7plcIoc: st.cmd files named on the command line, then the shell. */
#include <epicsExit.h>
#include <epicsThread.h>
#include <iocsh.h>

int main(int argc, char *argv[])
{
    for (int i = 1; i < argc; i++)
        iocsh(argv[i]);
    iocsh(NULL);
    epicsExit(0);
    return 0;
}

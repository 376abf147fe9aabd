/* The main program of benchIoc: an IOC with the shell on standard input. */
#include <epicsExit.h>
#include <iocsh.h>

int main()
{
    iocsh(NULL);
    epicsExit(0);
    return 0;
}

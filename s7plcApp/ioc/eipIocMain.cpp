/* The main program of eipIoc: st.cmd files named on the command line, then the shell; or, where
 * options are given, an IOC without st.cmd:
 *     eipIoc [-v verbosity] -p plc=ip[,slot] ... [-m macros] -d file.db ...
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <string>

#include <epicsExit.h>
#include <iocsh.h>

#include "drvEtherIP.h"

static int usage()
{
    fputs("usage: eipIoc st.cmd ...\n"
          "       eipIoc [-v verbosity] -p plc=ip[:port][,slot] ... [-m macros] -d file.db ...\n",
          stderr);
    return 2;
}

/* Where the dbd file is: beside the program. */
static std::string dbdOf(const char *program)
{
    std::string path(program);
    size_t slash = path.rfind("/bin/");

    return (slash == std::string::npos ? std::string("..") : path.substr(0, slash)) +
           "/dbd/eipIoc.dbd";
}

static bool definePlc(const char *text)
{
    std::string whole(text);
    size_t equal = whole.find('='), comma = whole.find(',');

    if (equal == std::string::npos || equal == 0)
        return false;
    std::string ip = whole.substr(equal + 1, comma == std::string::npos
                                                 ? std::string::npos : comma - equal - 1);
    int slot = comma == std::string::npos ? 0 : atoi(whole.c_str() + comma + 1);
    return drvEtherIP_define_PLC(whole.substr(0, equal).c_str(), ip.c_str(), slot) == 0;
}

static bool command(const char *name, const char *first, const char *second)
{
    std::string line = std::string(name) + "(\"" + first + "\",\"" + second + "\")";

    return iocshCmd(line.c_str()) == 0;
}

/* The options in their order. Returns false after an error. */
static bool option(char letter, const char *text, std::string &macros)
{
    switch (letter) {
    case 'v':
        EIP_verbosity = atoi(text);
        return true;
    case 'p':
        return definePlc(text);
    case 'm':
        macros = text;
        return true;
    case 'd':
        return command("dbLoadRecords", text, macros.c_str());
    default:
        usage();
        return false;
    }
}

int main(int argc, char *argv[])
{
    std::string macros;

    if (argc > 1 && argv[1][0] == '-') {
        if (!command("dbLoadDatabase", dbdOf(argv[0]).c_str(), "") ||
            iocshCmd("eipIoc_registerRecordDeviceDriver(pdbbase)"))
            return 1;
        for (int i = 1; i < argc; i += 2)
            if (argv[i][0] != '-' || i + 1 >= argc || !option(argv[i][1], argv[i + 1], macros))
                return i + 1 >= argc ? usage() : 1;
        iocshCmd("iocInit");
    } else {
        for (int i = 1; i < argc; i++)
            iocsh(argv[i]);
    }
    iocsh(NULL);
    epicsExit(0);
    return 0;
}

/* The main program of eipIoc: st.cmd files named on the command line, then the shell; or, where
 * options are given, an IOC without st.cmd:
 *     eipIoc [-v verbosity] -p plc=ip[,slot] ... [-m macros] -d file.db ...
 */
#include <stdio.h>
#include <stdlib.h>
#include <string>

#include <epicsExit.h>
#include <errlog.h>
#include <iocsh.h>
#include <osiFileName.h>

static int usage()
{
    fputs("usage: eipIoc st.cmd ...\n"
          "       eipIoc [-v verbosity] -p plc=ip[:port][,slot] ... [-m macros] -d file.db ...\n",
          stderr);
    return 2;
}

/* Where the dbd file is: beside the directory of the program, TOP/bin/ARCH/. */
static std::string dbdFile()
{
    char *directory = epicsGetExecDir();
    std::string path = std::string(directory ? directory : "") + "../../dbd/eipIoc.dbd";

    free(directory);
    return path;
}

/* A command of the shell, which says what is wrong. Returns false after an error. */
static bool command(const char *name, const std::string &arguments)
{
    return iocshCmd((std::string(name) + "(\"" + arguments + "\")").c_str()) == 0;
}

static const char comma[] = "\",\"";

static bool definePlc(const std::string &text)
{
    size_t equal = text.find('='), slot = text.find(',');

    if (equal == std::string::npos || equal == 0 || slot < equal) {
        fprintf(stderr, "eipIoc: -p \"%s\"; allowed: -p plc=ip[:port][,slot]\n", text.c_str());
        return false;
    }
    std::string arguments = text;
    if (slot != std::string::npos)
        arguments.replace(slot, 1, comma);
    return command("drvEtherIP_define_PLC", arguments.replace(equal, 1, comma));
}

/* The options in their order. Returns false after an error. */
static bool option(const char *letter, const char *text, std::string &macros)
{
    switch (letter[0] == '-' && letter[1] && !letter[2] ? letter[1] : 0) {
    case 'v':
        return command("EIP_verbosity", text);
    case 'p':
        return definePlc(text);
    case 'm':
        macros = text;
        return true;
    case 'd':
        return command("dbLoadRecords", std::string(text) + comma + macros);
    default:
        fprintf(stderr, "eipIoc: \"%s\" is no option\n", letter);
        usage();
        return false;
    }
}

/* Without st.cmd. Returns 0, or the exit status after an error. */
static int runOptions(int argc, char *argv[])
{
    std::string macros;

    if (!command("dbLoadDatabase", dbdFile()) ||
        iocshCmd("eipIoc_registerRecordDeviceDriver(pdbbase)"))
        return 1;
    for (int i = 1; i < argc; i += 2) {
        if (i + 1 >= argc) {
            fprintf(stderr, "eipIoc: nothing stands behind \"%s\"\n", argv[i]);
            return usage();
        }
        if (!option(argv[i], argv[i + 1], macros))
            return 1;
    }
    return iocshCmd("iocInit") ? 1 : 0;
}

int main(int argc, char *argv[])
{
    if (argc > 1 && argv[1][0] == '-') {
        int status = runOptions(argc, argv);

        if (status) {
            errlogFlush(); /* what commands have said */
            return status;
        }
    } else {
        for (int i = 1; i < argc; i++)
            iocsh(argv[i]);
    }
    iocsh(NULL);
    epicsExit(0);
    return 0;
}

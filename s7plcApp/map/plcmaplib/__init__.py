"""plcmap: one map of a PLC's values, and everything that is made from it.

The floors, bottom up; each module imports only from those before it:

    problems                 what is wrong, where, what is allowed
    types, address           data types of a PLC and their bytes; places in PLC memory
    sheets, workbook         tables in CSV files and .xlsx files; every cell knows its place
    columns                  which columns and keys there are, and what they allow
    model, files             the map as rows, types, enums; expanded to single values (leaves)
    transfer                 which bytes of PLC memory go where in the blocks; layout id
    check, place, show, diff
    outputs                  one module per file that is generated
    imports                  one module per form of symbol exports
    prove                    IOC and simulator run against each other
    main                     the command line
"""
try:
    from .version import VERSION    # made from configure/CONFIG_PLCLINK_VERSION by make
except ImportError:
    VERSION = "unknown (not built)"

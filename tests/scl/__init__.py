"""SCL of the documents as a program that runs: the subset of STEP 7 classic SCL that
docs/plc-programming.md and docs/plc-tables.scl use.

    parse    text to a tree with positions
    types    types and the layout of standard blocks
    check    the tree to typed Python, as strict as the classic compiler
    blocks   BLKMOV, TEST_DB, timers, AG_SEND and others
    machine  memory, blocks, one cycle after another
    plc      a PLC on TCP with a console, in place of plcSim
    texts    SCL out of the documents, fitted to other block sizes

Used by tests only. It is one idea of what the compiler does, written after its manual, and
no proof: a run in STEP 7 or TIA remains that.
"""

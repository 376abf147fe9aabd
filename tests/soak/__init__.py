"""A long run under random faults: a PLC side and clients that know what every value must be.

`make soak`; what is checked and how: docs/soak.md.
"""

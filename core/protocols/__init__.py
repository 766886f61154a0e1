"""Contracts of the parts of a simulation, and the data that they pass to each other. Arrays are
float64 unless said otherwise; units are SI.

One file per concept; a contract is a class from which plugins, and the objects that they build,
derive: what has no default must be written. A plugin is a frozen set of options; the objects that
its methods return hold the numbers. Plugins and solvers keep no state between calls: a time step
writes only to the memory passed to it.
"""

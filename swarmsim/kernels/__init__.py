"""Compiled loops: arrays in, arrays out, nothing else known."""

from swarmsim.kernels.compiling import find_a_place

find_a_place()  # before the first kernel is named, for numba looks there and then

"""Compiled loops: arrays in, arrays out."""

from swarmsim.kernels.compiling import find_a_place

find_a_place()  # before the first kernel is defined: numba looks it up then

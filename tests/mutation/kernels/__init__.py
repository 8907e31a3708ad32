"""Mutants of the C++ kernels, all compiled into one build and chosen at run time."""

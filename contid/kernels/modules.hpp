// The entries of the extension modules that one file of bindings is linked to: KERNEL_MODULE, for every processor, and
// KERNEL_MODULE_WIDE, for wider registers. Included once, at the end of the bindings: compiled by itself, it would take
// as long as nanobind's headers for each.
#pragma once

#include "python.hpp"

// A domain each: both register the same C++ types, and a test may load both.
#define CONTID_DOMAIN KERNEL_MODULE
NB_MODULE(KERNEL_MODULE, module) { contid::bind(module); }
#undef CONTID_DOMAIN
#define CONTID_DOMAIN KERNEL_MODULE_WIDE
NB_MODULE(KERNEL_MODULE_WIDE, module) { contid::bind(module); }

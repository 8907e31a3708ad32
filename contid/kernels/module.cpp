// The entry of an extension module whose bindings are linked to two builds: for every processor, and for wider
// registers.
#include <nanobind/nanobind.h>

namespace contid {
void bind(nanobind::module_& module);
}

NB_MODULE(KERNEL_MODULE, module) { contid::bind(module); }

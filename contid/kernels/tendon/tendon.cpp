// contid.kernels._tendon: the solver of contid/kernels/arc over the bends of tendon robots.
#include <string>

#define CONTID_VARIABLES "two numbers per section"
#include "../arc/bindings.hpp"

namespace nb = nanobind;
using contid::read, contid::SectionSolver;

namespace {

void make(SectionSolver* self, nb::handle backbone, nb::handle rigid, nb::handle offset, nb::handle bend_max,
          nb::handle normals, nb::handle offsets, nb::handle tuning) {
  contid::TendonSetup s{};
  const int count = s.count = contid::count_of(backbone);
  const Py_ssize_t planes = PyObject_Length(offsets.ptr());
  if (planes < 0 || planes > contid::kMostPlanes) throw nb::value_error("too many limits");
  s.offsets.resize(planes), s.normals.resize(planes * 2 * count);
  read(backbone, s.backbone, count, "backbone: one number per section");
  read(rigid, s.rigid, count, "rigid: one number per section");
  read(offset, s.offset, 2, "offset: two numbers");
  read(bend_max, s.bend_max, count, "bend_max: one number per section");
  read(offsets, s.offsets.data(), planes, "offsets: one number per plane");
  read(normals, s.normals.data(), planes * 2 * count, "normals: two numbers per section and plane");
  s.tuning = contid::tuning_of(tuning);
  auto* make_solver = &contid::any_sections::make_tendon_solver;
  if (count == 3 && contid::three_sections::make_tendon_solver)
    make_solver = &contid::three_sections::make_tendon_solver;
  new (self) SectionSolver{make_solver(s)};
}

nb::object solve(const SectionSolver& self, nb::handle tip, nb::handle direction, nb::handle mid, nb::handle seed,
                 nb::handle rotation) {
  const auto bits = [](const std::uint64_t* binding) {  // more than any C++ integer has
    std::string digits;
    int used = contid::Answer::kWords;
    while (used > 1 && binding[used - 1] == 0) --used;
    for (int k = 64 * used - 1; k >= 0; --k) digits += binding[k / 64] >> k % 64 & 1 ? '1' : '0';
    return nb::steal<nb::int_>(PyLong_FromString(digits.c_str(), nullptr, 2));
  };
  return contid::solve_row(self, tip, direction, mid, seed, rotation, false, bits);
}

}  // namespace

void contid::bind(nb::module_& module) {
  module.doc() = "Bends of tendon robots: frames, Jacobians and bounded inverse kinematics, by the solver of arcs.";
  nb::class_<SectionSolver>(module, "SectionSolver")
      .def("__init__", &make, nb::arg("backbone"), nb::arg("rigid"), nb::arg("offset"), nb::arg("bend_max"),
           nb::arg("normals"), nb::arg("offsets"), nb::arg("tuning"))
      .def("forward", &contid::forward_row, nb::arg("bends"))
      .def("avoid", &contid::avoid_rows, nb::arg("obstacles"), nb::arg("radius"), nb::arg("margin"), nb::arg("from_"),
           nb::arg("zone"), nb::arg("force"))
      .def("differentiate", &contid::differentiate_row, nb::arg("bends"), nb::arg("tip").noconvert(),
           nb::arg("spin").noconvert(), nb::arg("mid").noconvert())
      .def("solve", &solve, nb::arg("tip"), nb::arg("direction").none(), nb::arg("mid").none(), nb::arg("seed"),
           nb::arg("rotation") = nb::none());
}

#include "../modules.hpp"

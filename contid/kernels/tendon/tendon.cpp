// contid.kernels._tendon: the solver of contid/kernels/arc over the bends of tendon robots.
#include <memory>

#include "../arc/bindings.hpp"

namespace nb = nanobind;
using contid::read, contid::SectionSolver;

namespace {

void make(SectionSolver* self, nb::handle backbone, nb::handle rigid, nb::handle offset, nb::handle bend_max,
          nb::handle normals, nb::handle offsets, nb::handle tuning) {
  const Py_ssize_t count = PyObject_Length(backbone.ptr()), planes = PyObject_Length(offsets.ptr());
  if (planes < 0 || planes > contid::kMaxPlanes) throw nb::value_error("too many limits");
  const auto held = std::make_unique<contid::Feasible>();
  contid::Feasible& f = *held;
  contid::Sections& s = f.sections;
  contid::set_count(s, count);
  const int n = s.size();
  read(backbone, s.backbone, count, "backbone: one number per section");
  read(rigid, s.rigid, count, "rigid: one number per section");
  read(offset, s.offset, 2, "offset: two numbers");
  read(bend_max, f.bend_max, count, "bend_max: one number per section");
  read(offsets, f.offsets, planes, "offsets: one number per plane");
  const auto rows = std::make_unique<double[]>(planes * n + 1);
  read(normals, rows.get(), planes * n, "normals: two numbers per section and plane");
  f.planes_count = static_cast<int>(planes);
  for (int k = 0; k < planes; ++k) std::memcpy(f.normals[k], rows.get() + k * n, n * sizeof(double));
  for (double& entry : f.metric) entry = 0.0;
  for (int i = 0; i < n; ++i) {
    const double most = s.backbone[i / 2] * f.bend_max[i / 2];
    f.low[i] = -most, f.high[i] = most;
    f.metric[i * contid::kMaxLengths + i] = 0.5;
  }
  for (int i = 0; i < count; ++i) {
    const double per_length[6] = {1.0 / s.backbone[i], 0.0, 0.0, 1.0 / s.backbone[i], 0.0, 0.0};
    std::memcpy(s.to_arc[i], per_length, sizeof per_length);
  }
  new (self) SectionSolver(f, contid::tuning_of(tuning));
}

nb::object solve(const SectionSolver& self, nb::handle tip, nb::handle direction, nb::handle mid, nb::handle seed,
                 nb::handle rotation) {
  const auto bits = [](const contid::LimitSet& binding) {  // more than any C++ integer has
    return nb::steal<nb::int_>(PyLong_FromString(binding.to_string().c_str(), nullptr, 2));
  };
  return contid::solve_row(self, tip, direction, mid, seed, rotation, bits);
}

}  // namespace

NB_MODULE(KERNEL_MODULE, module) {
  module.doc() = "Bends of tendon robots: frames, Jacobians and bounded inverse kinematics, by the solver of arcs.";
  nb::class_<SectionSolver>(module, "SectionSolver")
      .def("__init__", &make, nb::arg("backbone"), nb::arg("rigid"), nb::arg("offset"), nb::arg("bend_max"),
           nb::arg("normals"), nb::arg("offsets"), nb::arg("tuning"))
      .def("forward", &contid::forward_row, nb::arg("bends"))
      .def("avoid", &contid::avoid_rows, nb::arg("obstacles"), nb::arg("radius"), nb::arg("margin"), nb::arg("from_"),
           nb::arg("zone"), nb::arg("force"))
      .def("differentiate", &contid::differentiate_row, nb::arg("bends"), nb::arg("tip"), nb::arg("spin"),
           nb::arg("mid"))
      .def("solve", &solve, nb::arg("tip"), nb::arg("direction").none(), nb::arg("mid").none(), nb::arg("seed"),
           nb::arg("rotation") = nb::none());
}

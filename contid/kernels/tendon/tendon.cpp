// contid.kernels._tendon: the solver of contid/kernels/arc over the bends of tendon robots.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <memory>

#include "../arc/section_solver.hpp"
#include "../python.hpp"

namespace nb = nanobind;
using contid::read, contid::SectionSolver, contid::tuple_of;

namespace {

using Out = nb::ndarray<double, nb::c_contig, nb::device::cpu>;

void fill(Out& out, const double (*rows)[contid::kMaxLengths], int columns, const char* what) {
  if (out.ndim() != 2 || out.shape(0) != 3 || static_cast<int>(out.shape(1)) != columns) throw nb::value_error(what);
  for (int k = 0; k < 3; ++k) std::memcpy(out.data() + k * columns, rows[k], columns * sizeof(double));
}

void make(SectionSolver* self, nb::handle backbone, nb::handle rigid, nb::handle offset, nb::handle bend_max,
          nb::handle normals, nb::handle offsets, nb::handle tuning) {
  const Py_ssize_t count = PyObject_Length(backbone.ptr()), planes = PyObject_Length(offsets.ptr());
  if (planes < 0 || planes > contid::kMaxPlanes) throw nb::value_error("too many limits");
  const auto held = std::make_unique<contid::Feasible>();
  contid::Feasible& f = *held;
  contid::Sections& s = f.sections;
#ifdef CONTID_SECTIONS
  if (count != CONTID_SECTIONS) throw nb::value_error("a build for another number of sections");
#else
  if (count < 1 || count > contid::kMaxSections) throw nb::value_error("one to eight sections");
  s.count = static_cast<int>(count);
#endif
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
  const auto number = [&](const char* name) { return nb::cast<double>(tuning.attr(name)); };
  const auto count_of = [&](const char* name) { return nb::cast<int>(tuning.attr(name)); };
  new (self) SectionSolver(
      f, {number("ell_m"), number("tolerance_m"), number("home_tolerance_m"), number("weight"), number("near"),
          count_of("home_steps"), number("contraction"), number("slow"), count_of("iterations"), count_of("settling"),
          count_of("starts"), count_of("agreeing"), number("tracking"), number("still_m"), number("still_error_m")});
}

// The numbers of the limits that bind.
nb::tuple numbers(const contid::LimitSet& bits, int limits) {
  nb::list out;
  for (int k = 0; k < limits; ++k)
    if (bits[k]) out.append(k);
  return nb::tuple(out);
}

nb::tuple forward(const SectionSolver& self, nb::handle bends) {
  double x[contid::kMaxLengths];
  read(bends, x, self.size(), "two numbers per section");
  contid::Frames frames;
  contid::forward(self.feasible().sections, x, frames);
  return nb::make_tuple(tuple_of(frames.tip, 3), tuple_of(frames.rotation, 9), tuple_of(frames.mid, 3));
}

nb::tuple solve(const SectionSolver& self, nb::handle tip, nb::handle direction, nb::handle mid, nb::handle seed) {
  double p[3], t[3], m[3], x[contid::kMaxLengths];
  read(tip, p, 3, "tip: three numbers");
  if (!direction.is_none()) read(direction, t, 3, "direction: three numbers");
  if (!mid.is_none()) read(mid, m, 3, "mid: three numbers");
  read(seed, x, self.size(), "seed: two numbers per section");
  contid::Answer answer;
  self.solve({p, direction.is_none() ? nullptr : t, mid.is_none() ? nullptr : m}, x, answer);
  return nb::make_tuple(tuple_of(answer.lengths, self.size()), answer.residual, answer.converged,
                        numbers(answer.binding, self.feasible().limits()), answer.iterations, answer.starts);
}

// Jacobians of tip, orientation and mid-point into given arrays (3, 2 n).
void differentiate(const SectionSolver& self, nb::handle bends, Out tip, Out spin, Out mid) {
  double x[contid::kMaxLengths];
  const int n = self.size();
  read(bends, x, n, "two numbers per section");
  contid::Derivatives at;
  contid::differentiate(self.feasible().sections, x, at, true);
  fill(tip, at.tip, n, "tip: an array (3, 2 n)");
  fill(spin, at.spin, n, "spin: an array (3, 2 n)");
  fill(mid, at.mid, n, "mid: an array (3, 2 n)");
}

}  // namespace

NB_MODULE(KERNEL_MODULE, module) {
  module.doc() = "Bends of tendon robots: native twin of contid.kinematics.tendon, with the solver of arcs.";
  nb::class_<SectionSolver>(module, "SectionSolver")
      .def("__init__", &make, nb::arg("backbone"), nb::arg("rigid"), nb::arg("offset"), nb::arg("bend_max"),
           nb::arg("normals"), nb::arg("offsets"), nb::arg("tuning"))
      .def("forward", &forward, nb::arg("bends"))
      .def("differentiate", &differentiate, nb::arg("bends"), nb::arg("tip"), nb::arg("spin"), nb::arg("mid"))
      .def("solve", &solve, nb::arg("tip"), nb::arg("direction").none(), nb::arg("mid").none(), nb::arg("seed"));
}

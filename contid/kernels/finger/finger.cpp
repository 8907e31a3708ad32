// contid.kernels._finger: one or many rows of a two-rack finger for Python.
#include "../batch_python.hpp"
#include "../python.hpp"
#include "boundary.hpp"

namespace nb = nanobind;
using contid::Boundary, contid::Finger, contid::Matrix, contid::Table;

namespace {

using Points = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// Poses of many rows; the GIL is released.
void forward_many(const Finger& self, Matrix racks, Table out, int threads) {
  const std::size_t rows = out.shape(0);
  contid::check(racks, rows, 2, "racks: an array (rows, 2)");
  contid::check(out, rows, contid::kPoseBytes);
  const nb::gil_scoped_release released;
  contid::over_rows(rows, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      double tip[3], t[3];
      tip[2] = t[2] = 0.0;
      self.forward(racks.data() + 2 * k, tip, t);
      const double rotation[9] = {t[1], t[0], 0.0, -t[0], t[1], 0.0, 0.0, 0.0, 1.0};
      contid::write_pose(out.data() + k * contid::kPoseBytes, tip, rotation, t, tip, true);
    }
  });
}

// Racks for tips within every limit; the others are left with converged = false, for the caller. The GIL is released.
void inverse_many(const Finger& self, Matrix tip, Table out, int threads) {
  const std::size_t rows = out.shape(0);
  contid::check(tip, rows, 3, "tip: an array (rows, 3)");
  contid::check(out, rows, contid::solution_bytes(2));
  const nb::gil_scoped_release released;
  contid::over_rows(rows, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const double* p = tip.data() + 3 * k;
      double racks[2] = {}, residual = 0.0;
      const bool met = self.inverse(p[0], p[1], racks, residual);
      contid::write_solution(out.data() + k * contid::solution_bytes(2), racks, 2, residual, 0, 0, met);
    }
  });
}

// x and y of the tip, its direction (sin, cos); short calls, under the GIL.
nb::tuple forward(const Finger& self, double left, double right) {
  const double racks[2] = {left, right};
  double xy[2], direction[2];
  self.forward(racks, xy, direction);
  return nb::make_tuple(xy[0], xy[1], direction[0], direction[1]);
}

// Racks for a tip within every limit, and its residual; None for any other.
nb::object inverse(const Finger& self, double x, double y) {
  double racks[2], residual;
  if (!self.inverse(x, y, racks, residual)) return nb::none();
  return nb::make_tuple(nb::make_tuple(racks[0], racks[1]), residual);
}

// The nearest racks within every limit.
nb::tuple clamp(const Finger& self, double left, double right) {
  const double racks[2] = {left, right};
  double nearest[2];
  self.clamp(racks, nearest);
  return nb::make_tuple(nearest[0], nearest[1]);
}

// Points along the finger, written to an array (points, 3).
void shape(const Finger& self, double left, double right, Points out) {
  if (out.shape(1) != 3 || out.shape(0) < 2) throw nb::value_error("out: an array (points, 3) of two points or more");
  const double racks[2] = {left, right};
  self.shape(racks, static_cast<int>(out.shape(0)), out.data());
}

void make_boundary(Boundary* self, const Finger& finger, nb::sequence pieces) {
  std::vector<std::vector<double>> all;
  for (const nb::handle piece : pieces) {
    std::vector<double>& samples = all.emplace_back(nb::len(piece));
    if (samples.size() < 2) throw nb::value_error("pieces: two samples or more in each");
    contid::read(piece, samples.data(), static_cast<Py_ssize_t>(samples.size()), "pieces: numbers");
  }
  if (all.empty()) throw nb::value_error("pieces: one or more");
  new (self) Boundary(finger, std::move(all));
}

// Racks of the point of the boundary whose tip is nearest; under the GIL.
nb::tuple nearest(Boundary& self, double x, double y) {
  double racks[2];
  self.nearest(x, y, racks);
  return nb::make_tuple(racks[0], racks[1]);
}

}  // namespace

NB_MODULE(KERNEL_MODULE, module) {
  module.doc() = "Two-rack fingers, one row or many at once.";
  nb::class_<Finger>(module, "Finger")
      .def(nb::init<double, double, double, double, double, double, double, double, double, double>(),
           nb::arg("spacing"), nb::arg("tip"), nb::arg("gain_per_m"), nb::arg("gain_offset"), nb::arg("gain_low"),
           nb::arg("gain_high"), nb::arg("length_min"), nb::arg("length_max"), nb::arg("curvature_max"),
           nb::arg("arc_length_min"))
      .def("forward", &forward, nb::arg("left"), nb::arg("right"))
      .def("inverse", &inverse, nb::arg("x"), nb::arg("y"))
      .def("clamp", &clamp, nb::arg("left"), nb::arg("right"))
      .def("shape", &shape, nb::arg("left"), nb::arg("right"), nb::arg("out").noconvert())
      .def("forward_many", &forward_many, nb::arg("actuations"), nb::arg("out").noconvert(), nb::arg("threads"))
      .def("inverse_many", &inverse_many, nb::arg("tip"), nb::arg("out").noconvert(), nb::arg("threads"));
  nb::class_<Boundary>(module, "Boundary")
      .def("__init__", &make_boundary, nb::arg("finger"), nb::arg("pieces"))
      .def("nearest", &nearest, nb::arg("x"), nb::arg("y"));
}

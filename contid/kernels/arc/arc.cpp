// contid.kernels._arc: constant-curvature sections for Python. Single calls take microseconds and hold the GIL.
#include "../batch_python.hpp"
#define CONTID_VARIABLES "three lengths per section"
#include "bindings.hpp"

namespace nb = nanobind;
using contid::Out, contid::read, contid::SectionSolver;

namespace {

void make(SectionSolver* self, nb::handle radius, nb::handle to_arc, nb::handle to_lengths, nb::handle rigid,
          nb::handle lower, nb::handle upper, nb::handle home, double rack, double curvature_max, nb::handle tuning) {
  contid::ArcSetup s{};
  const int count = s.count = contid::count_of(radius);
  read(radius, s.radius, count, "radius: one number per section");
  read(rigid, s.rigid, count, "rigid: one number per section");
  read(to_arc, s.to_arc[0], 9 * count, "to_arc: nine numbers per section");
  read(to_lengths, s.to_lengths[0], 9 * count, "to_lengths: nine numbers per section");
  read(lower, s.lower, count, "lower: one number per section");
  read(upper, s.upper, count, "upper: one number per section");
  read(home, s.home, 3 * count, "home: one number per length");
  s.rack = rack, s.curvature_max = curvature_max, s.tuning = contid::tuning_of(tuning);
  auto* make_solver = &contid::any_sections::make_arc_solver;
  if (count == 1 && contid::one_section::make_arc_solver) make_solver = &contid::one_section::make_arc_solver;
  if (count == 2 && contid::two_sections::make_arc_solver) make_solver = &contid::two_sections::make_arc_solver;
  new (self) SectionSolver{make_solver(s)};
}

nb::object solve(const SectionSolver& self, nb::handle tip, nb::handle direction, nb::handle mid, nb::handle seed,
                 nb::handle rotation, bool follows) {
  const auto bits = [](const std::uint64_t* binding) { return binding[0]; };
  return contid::solve_row(self, tip, direction, mid, seed, rotation, follows, bits);
}

// Solve a path, each point from the previous answer: for benchmarks of the kernel alone.
int follow(const SectionSolver& self, Out tips, nb::handle seed, Out lengths) {
  const std::size_t n = self.size();
  if (tips.ndim() != 2 || tips.shape(1) != 3 || lengths.ndim() != 2 || lengths.shape(0) != tips.shape(0) ||
      lengths.shape(1) != n)
    throw nb::value_error("tips (points, 3) and lengths (points, 3 n)");
  double l[contid::kMostVariables];
  read(seed, l, n, "seed: " CONTID_VARIABLES);
  int met = 0;
  for (std::size_t k = 0; k < tips.shape(0); ++k) {
    contid::Answer answer;
    self.chain->solve({tips.data() + 3 * k, nullptr, nullptr}, l, answer);
    std::memcpy(l, answer.lengths, sizeof l);
    std::memcpy(lengths.data() + n * k, l, n * sizeof(double));
    met += answer.converged;
  }
  return met;
}

// Poses of many rows; the GIL is released.
void forward_many(const SectionSolver& self, contid::Matrix lengths, contid::Table out, int threads) {
  const std::size_t rows = out.shape(0);
  contid::check(lengths, rows, self.size(), "lengths: an array (rows, 3 n)");
  contid::check(out, rows, contid::kPoseBytes);
  const nb::gil_scoped_release released;
  self.chain->forward_rows(lengths.data(), rows, threads, out.data());
}

// Answers for many rows; the GIL is released.
void inverse_many(const SectionSolver& self, contid::Matrix tip, nb::handle direction, nb::handle mid,
                  contid::Matrix seeds, bool chained, contid::Table out, int threads) {
  const std::size_t rows = out.shape(0);
  const contid::TargetRows targets = contid::targets_of(tip, direction, mid, nb::none());
  contid::check(tip, rows, 3, "tip: an array (rows, 3)");
  contid::check(seeds, chained ? 1 : rows, self.size(), "seeds: an array (rows, 3 n)");
  contid::check(out, rows, contid::solution_bytes(self.size()));
  const nb::gil_scoped_release released;
  self.chain->inverse_rows(targets, rows, seeds.data(), chained, threads, out.data());
}

}  // namespace

void contid::bind(nb::module_& module) {
  module.doc() = "Chains of constant-curvature sections: frames, Jacobians and bounded inverse kinematics.";
  nb::class_<SectionSolver>(module, "SectionSolver")
      .def("__init__", &make, nb::arg("radius"), nb::arg("to_arc"), nb::arg("to_lengths"), nb::arg("rigid"),
           nb::arg("lower"), nb::arg("upper"), nb::arg("home"), nb::arg("rack"), nb::arg("curvature_max"),
           nb::arg("tuning"))
      .def("forward", &contid::forward_row, nb::arg("lengths"))
      .def("avoid", &contid::avoid_rows, nb::arg("obstacles"), nb::arg("radius"), nb::arg("margin"), nb::arg("from_"),
           nb::arg("zone"), nb::arg("force"))
      .def("differentiate", &contid::differentiate_row, nb::arg("lengths"), nb::arg("tip").noconvert(),
           nb::arg("spin").noconvert(), nb::arg("mid").noconvert())
      .def("solve", &solve, nb::arg("tip"), nb::arg("direction").none(), nb::arg("mid").none(), nb::arg("seed"),
           nb::arg("rotation") = nb::none(), nb::arg("follows") = false)
      .def("forward_many", &forward_many, nb::arg("actuations"), nb::arg("out").noconvert(), nb::arg("threads"))
      .def("inverse_many", &inverse_many, nb::arg("tip"), nb::arg("direction").none(), nb::arg("mid").none(),
           nb::arg("seeds"), nb::arg("chained"), nb::arg("out").noconvert(), nb::arg("threads"))
      .def("follow", &follow, nb::arg("tips"), nb::arg("seed"), nb::arg("lengths").noconvert());
}

#include "../modules.hpp"

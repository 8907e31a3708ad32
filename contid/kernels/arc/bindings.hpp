// What the bindings of both kinds of sections share: contid.kernels._arc and contid.kernels._tendon. For messages the
// file that includes it defines CONTID_VARIABLES.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "../python.hpp"
#include "../record.hpp"
#include "solver.hpp"

namespace contid {

using Out = nanobind::ndarray<double, nanobind::c_contig, nanobind::device::cpu>;

// The solver as Python holds it.
struct SectionSolver {
  std::unique_ptr<ChainSolver> chain;

  int size() const { return chain->size(); }
};

// The number of sections, or ValueError.
inline int count_of(nanobind::handle per_section) {
  const Py_ssize_t count = PyObject_Length(per_section.ptr());
  if (count < 1 || count > kMostSections) throw nanobind::value_error("one to eight sections");
  return static_cast<int>(count);
}

inline Tuning tuning_of(nanobind::handle tuning) {
  const auto number = [&](const char* name) { return nanobind::cast<double>(tuning.attr(name)); };
  const auto integer = [&](const char* name) { return nanobind::cast<int>(tuning.attr(name)); };
  return {number("ell_m"),       number("tolerance_m"), number("home_tolerance_m"), number("weight"),
          number("near"),        integer("home_steps"), number("contraction"),      number("slow"),
          integer("iterations"), integer("settling"),   integer("starts"),          integer("agreeing"),
          number("tracking"),    number("still_m"),     number("still_error_m")};
}

// Obstacles as rows of the kernel clearance in the base frame.
inline void avoid_rows(SectionSolver& self, nanobind::handle obstacles, double radius, double margin, double from,
                       double zone, double force) {
  Surroundings around;
  for (const nanobind::handle row : obstacles) {
    double packed[17];
    read(row, packed, 17, "obstacles: seventeen numbers each");
    around.obstacles.emplace_back(packed);
  }
  around.radius = radius, around.margin = margin, around.from = from, around.zone = zone, around.force = force;
  self.chain->avoid(around);
}

inline nanobind::object forward_row(const SectionSolver& self, nanobind::handle variables) {
  double x[kMostVariables];
  read(variables, x, self.size(), CONTID_VARIABLES);
  Frames frames;
  self.chain->forward(x, frames);
  static const Record record("contid.kernels.SectionFrames", {"tip", "rotation", "mid"});
  return record(tuple_of(frames.tip, 3), tuple_of(frames.rotation, 9), tuple_of(frames.mid, 3));
}

// `binding`: the limits that bind, from their bits to what Python gets.
template <class Binding>
nanobind::object solve_row(const SectionSolver& self, nanobind::handle tip, nanobind::handle direction,
                           nanobind::handle mid, nanobind::handle seed, nanobind::handle rotation, bool follows,
                           const Binding& binding) {
  double p[3], t[3], m[3], r[9], x[kMostVariables];
  read(tip, p, 3, "tip: three numbers");
  if (!direction.is_none()) read(direction, t, 3, "direction: three numbers");
  if (!mid.is_none()) read(mid, m, 3, "mid: three numbers");
  if (!rotation.is_none()) read(rotation, r, 9, "rotation: nine numbers, row by row");
  if (!direction.is_none() && !rotation.is_none())
    throw nanobind::value_error("rotation: stands instead of a direction");
  read(seed, x, self.size(), "seed: " CONTID_VARIABLES);
  Answer answer;
  self.chain->solve(
      {p, direction.is_none() ? nullptr : t, mid.is_none() ? nullptr : m, rotation.is_none() ? nullptr : r, follows}, x,
      answer);
  static const Record record("contid.kernels.SectionSolution",
                             {"lengths", "residual_m", "converged", "binding", "iterations", "starts"});
  return record(tuple_of(answer.lengths, self.size()), answer.residual, answer.converged, binding(answer.binding),
                answer.iterations, answer.starts);
}

// Jacobians of tip, orientation and mid-point into given arrays, one column per variable.
inline void differentiate_row(const SectionSolver& self, nanobind::handle variables, Out tip, Out spin, Out mid) {
  double x[kMostVariables];
  const std::size_t n = self.size();
  read(variables, x, n, CONTID_VARIABLES);
  const auto check = [n](const Out& out, const char* what) {
    if (out.ndim() != 2 || out.shape(0) != 3 || out.shape(1) != n) throw nanobind::value_error(what);
  };
  check(tip, "tip: an array (3, variables)");
  check(spin, "spin: an array (3, variables)");
  check(mid, "mid: an array (3, variables)");
  self.chain->differentiate(x, tip.data(), spin.data(), mid.data());
}

}  // namespace contid

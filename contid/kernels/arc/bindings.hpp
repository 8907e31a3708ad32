// What the bindings of both kinds of sections share: contid.kernels._arc and contid.kernels._tendon.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "../python.hpp"
#include "../record.hpp"
#include "section_solver.hpp"

// For messages; a literal, because they are joined when compiled.
#ifdef CONTID_TENDON
#define CONTID_VARIABLES "two numbers per section"
#define CONTID_COLUMNS "an array (3, 2 n)"
#else
#define CONTID_VARIABLES "three lengths per section"
#define CONTID_COLUMNS "an array (3, 3 n)"
#endif

namespace contid {

using Out = nanobind::ndarray<double, nanobind::c_contig, nanobind::device::cpu>;

inline void fill(Out& out, const Column* from, int columns, const char* what) {
  if (out.ndim() != 2 || out.shape(0) != 3 || static_cast<int>(out.shape(1)) != columns)
    throw nanobind::value_error(what);
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < columns; ++j) out.data()[k * columns + j] = from[j][k];
}

// The number of sections, or ValueError for one that this build has not.
inline void set_count([[maybe_unused]] Sections& sections, Py_ssize_t count) {
#ifdef CONTID_SECTIONS
  if (count != CONTID_SECTIONS) throw nanobind::value_error("a build for another number of sections");
#else
  if (count < 1 || count > kMaxSections) throw nanobind::value_error("one to eight sections");
  sections.count = static_cast<int>(count);
#endif
}

inline Tuning tuning_of(nanobind::handle tuning) {
  const auto number = [&](const char* name) { return nanobind::cast<double>(tuning.attr(name)); };
  const auto count_of = [&](const char* name) { return nanobind::cast<int>(tuning.attr(name)); };
  return {number("ell_m"),        number("tolerance_m"),  number("home_tolerance_m"), number("weight"),
          number("near"),         count_of("home_steps"), number("contraction"),      number("slow"),
          count_of("iterations"), count_of("settling"),   count_of("starts"),         count_of("agreeing"),
          number("tracking"),     number("still_m"),      number("still_error_m")};
}

// Obstacles as rows of the kernel clearance in the base frame; see Avoid.
inline void avoid_rows(SectionSolver& self, nanobind::handle obstacles, double radius, double margin, double from,
                       double zone, double force) {
  Avoid around;
  for (const nanobind::handle row : obstacles) {
    double packed[17];
    read(row, packed, 17, "obstacles: seventeen numbers each");
    around.obstacles.emplace_back(packed);
  }
  around.radius = radius, around.margin = margin, around.from = from, around.zone = zone, around.force = force;
  self.avoid(around);
}

inline nanobind::object forward_row(const SectionSolver& self, nanobind::handle variables) {
  double x[kMaxLengths];
  read(variables, x, self.size(), CONTID_VARIABLES);
  Frames frames;
  forward(self.feasible().sections, x, frames);
  static const Record record("contid.kernels.SectionFrames", {"tip", "rotation", "mid"});
  return record(tuple_of(frames.tip, 3), tuple_of(frames.rotation, 9), tuple_of(frames.mid, 3));
}

// `binding`: the limits that bind, from their bits to what Python gets.
template <class Binding>
nanobind::object solve_row(const SectionSolver& self, nanobind::handle tip, nanobind::handle direction,
                           nanobind::handle mid, nanobind::handle seed, nanobind::handle rotation,
                           const Binding& binding) {
  double p[3], t[3], m[3], r[9], x[kMaxLengths];
  read(tip, p, 3, "tip: three numbers");
  if (!direction.is_none()) read(direction, t, 3, "direction: three numbers");
  if (!mid.is_none()) read(mid, m, 3, "mid: three numbers");
  if (!rotation.is_none()) read(rotation, r, 9, "rotation: nine numbers, row by row");
  read(seed, x, self.size(), "seed: " CONTID_VARIABLES);
  Answer answer;
  self.solve({p, direction.is_none() ? nullptr : t, mid.is_none() ? nullptr : m, rotation.is_none() ? nullptr : r}, x,
             answer);
  static const Record record("contid.kernels.SectionSolution",
                             {"lengths", "residual_m", "converged", "binding", "iterations", "starts"});
  return record(tuple_of(answer.lengths, self.size()), answer.residual, answer.converged, binding(answer.binding),
                answer.iterations, answer.starts);
}

// Jacobians of tip, orientation and mid-point into given arrays, one column per variable.
inline void differentiate_row(const SectionSolver& self, nanobind::handle variables, Out tip, Out spin, Out mid) {
  double x[kMaxLengths];
  const int n = self.size();
  read(variables, x, n, CONTID_VARIABLES);
  Derivatives at;
  differentiate(self.feasible().sections, x, at, true);
  fill(tip, at.tip, n, "tip: " CONTID_COLUMNS);
  fill(spin, at.spin, n, "spin: " CONTID_COLUMNS);
  fill(mid, at.mid, n, "mid: " CONTID_COLUMNS);
}

}  // namespace contid

// Many rows of a chain of sections, each as the single call answers it.
#pragma once

#include "../batch.hpp"
#include "section_solver.hpp"

namespace contid {

inline void forward_rows(const Sections& sections, const double* lengths, std::size_t rows, int threads,
                         std::uint8_t* out) {
  over_rows(rows, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      Frames at;
      forward(sections, lengths + k * sections.size(), at);
      const double direction[3] = {at.rotation[2], at.rotation[5], at.rotation[8]};
      write_pose(out + k * kPoseBytes, at.tip, at.rotation, direction, at.mid, true);
    }
  });
}

// `seeds`: one row for each target, or with `chained` the start of the first; then one thread does all rows.
inline void inverse_rows(const SectionSolver& solver, const TargetRows& targets, std::size_t rows, const double* seeds,
                         bool chained, int threads, std::uint8_t* out) {
  const int n = solver.size();
  const auto solve = [&](std::size_t k, const double* seed, Answer& answer) {
    solver.solve({targets.tip + 3 * k, targets.row(targets.direction, k), targets.row(targets.mid, k)}, seed, answer);
    write_solution(out + k * solution_bytes(n), answer.lengths, n, answer.residual, answer.binding.to_ullong(),
                   answer.iterations, answer.converged);
  };
  if (chained) {
    double last[kMaxLengths];
    std::memcpy(last, seeds, n * sizeof(double));
    for (std::size_t k = 0; k < rows; ++k) {
      Answer answer;
      solve(k, last, answer);
      std::memcpy(last, answer.lengths, n * sizeof(double));
    }
    return;
  }
  over_rows(rows, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      Answer answer;
      solve(k, seeds + k * n, answer);
    }
  });
}

}  // namespace contid

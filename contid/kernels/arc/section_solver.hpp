// Bounded inverse kinematics of a chain of sections from several starts.
//
//     minimise  |e(x)|   over the feasible variables x, of the minima where e = 0 the one nearest to home
//
// e is the error of the task (section_task.hpp), x are lengths, or bends of tendon robots (feasible.hpp). The closed
// form comes first where there is one, then a descent (descent.hpp) from the seed. Where that does not meet the target,
// further descents start from biarcs (for tip and direction) and from the postures of a fixed library of Halton points
// whose task is nearest to the goal. The search stops at the first start that meets the target, where enough starts end
// at the same error, or when all have been tried. A goal out of reach that is followed has no search while the answer
// next to the seed is stationary (Descent::stationary). solve() does not allocate.
#pragma once

#include <algorithm>

#include "../halton.hpp"
#include "closed_form.hpp"
#include "descent.hpp"

namespace contid::section_build {

constexpr int kLibrary = 256;
// A start of a whole frame that fails is left after as many Newton steps: most frames are met from the next one.
constexpr int kBrief = 10;
constexpr double kMaxError = 1e6;  // larger than the error of any arm [m]; its square does not overflow

inline double squared_distance(const double* a, const double* b) {
  double sum = 0.0;
  for (int k = 0; k < 3; ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
  return sum;
}

class SectionSolver final : public ChainSolver {
 public:
  SectionSolver(const Feasible& feasible, const Tuning& tuning) : descent_(feasible, tuning) {
    for (int k = 0; k < kLibrary; ++k) {
      for (int i = 0; i < feasible.size(); ++i)
        library_[k][i] = feasible.low[i] + radical_inverse(k + 1, kPrimes[i]) * (feasible.high[i] - feasible.low[i]);
      feasible.pull(library_[k]);
      section_build::forward(feasible.sections, library_[k], frames_[k]);
    }
  }

  const Feasible& feasible() const { return descent_.feasible; }
  int size() const override { return feasible().size(); }

  void forward(const double* variables, Frames& out) const override {
    section_build::forward(feasible().sections, variables, out);
  }

  void differentiate(const double* variables, double* tip, double* spin, double* mid) const override {
    Derivatives at;
    section_build::differentiate(feasible().sections, variables, at, true);
    const int n = size();
    for (int k = 0; k < 3; ++k)
      for (int j = 0; j < n; ++j)
        tip[k * n + j] = at.tip[j][k], spin[k * n + j] = at.spin[j][k], mid[k * n + j] = at.mid[j][k];
  }

  // Obstacles that redundant axes keep away from; none switches that off.
  void avoid(const Surroundings& around) override { avoid_ = Avoid(around); }

  // The closed form where there is one, then the seed, then starts for what the seed does not meet.
  void solve(const Goal& goal, const double* seed, Answer& out) const override {
    const int n = size();
    out.iterations = 0;
    out.starts = 0;
    if (!avoid_.obstacles.empty() && redundant(goal)) {
      if (solve_around(goal, seed, out)) return finish(out);
      out.iterations = 0;
    }
    if (closed_form(goal, out.lengths)) {
      feasible().clip(out.lengths);
      out.residual = descent_.error(out.lengths, goal);
      return finish(out);
    }
    double trial[kMaxLengths], begun[kMaxLengths];
    std::memcpy(trial, seed, n * sizeof(double));
    feasible().pull(trial);
    std::memcpy(begun, trial, n * sizeof(double));
    Task task;
    descent_.evaluate(trial, goal, task);
    if (!(task.error < kMaxError)) {  // NaN included
      std::memcpy(out.lengths, trial, n * sizeof(double));
      out.residual = task.error;
      return finish(out);
    }
    out.residual = descent_.run_from(task, trial, goal, out.iterations, nullptr, settling(goal));
    out.starts = 1;
    std::memcpy(out.lengths, trial, sizeof trial);
    if (out.residual > tuning().tolerance) {
      const SearchLimits few = limits(goal, begun, trial);
      if (goal.follows && few.starts == tuning().agreeing && descent_.stationary(task, trial)) return finish(out);
      Search search(goal, few);
      const bool biarcs = kColumns == 3 && feasible().sections.count == 2 && goal.direction && !goal.mid;
      if (!biarcs || !try_biarcs(search, out)) try_library(search, out);
      if (goal.rotation && out.residual > tuning().tolerance)
        out.residual = descent_.run(out.lengths, goal, out.iterations);
    }
    finish(out);
  }

  void forward_rows(const double* variables, std::size_t rows, int threads, std::uint8_t* out) const override {
    over_rows(rows, threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) {
        Frames at;
        forward(variables + k * size(), at);
        const double direction[3] = {at.rotation[2], at.rotation[5], at.rotation[8]};
        write_pose(out + k * kPoseBytes, at.tip, at.rotation, direction, at.mid, true);
      }
    });
  }

  void inverse_rows(const TargetRows& targets, std::size_t rows, const double* seeds, bool chained, int threads,
                    std::uint8_t* out) const override {
    const int n = size();
    const auto solve_row = [&](std::size_t k, const double* seed, Answer& answer) {
      solve({targets.tip + 3 * k, targets.row(targets.direction, k), targets.row(targets.mid, k)}, seed, answer);
      write_solution(out + k * solution_bytes(n), answer.lengths, n, answer.residual, answer.binding[0],
                     answer.iterations, answer.converged);
    };
    if (chained) {
      double last[kMaxLengths];
      std::memcpy(last, seeds, n * sizeof(double));
      for (std::size_t k = 0; k < rows; ++k) {
        Answer answer;
        solve_row(k, last, answer);
        std::memcpy(last, answer.lengths, n * sizeof(double));
      }
      return;
    }
    over_rows(rows, threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) {
        Answer answer;
        solve_row(k, seeds + k * n, answer);
      }
    });
  }

 private:
  // End of the search for a target that is not met: the number of agreeing starts, or of all.
  struct SearchLimits {
    int agreeing, starts;
  };

  struct Search {
    const Goal& goal;
    const SearchLimits limits;
    int agreeing = 1;  // starts that end at the best answer
    Search(const Goal& goal, SearchLimits limits) : goal(goal), limits(limits) {}
  };

  // True when a task leaves axes free. A direction holds two.
  bool redundant(const Goal& goal) const {
    return size() > 3 + (goal.direction ? 2 : 0) + (goal.rotation ? 3 : 0) + (goal.mid ? 3 : 0);
  }

  // An answer that keeps the margin, from the seed or, unless that follows a bounded optimum, from the library. Without
  // one the answer from the seed that meets the target, as far off as it can be; false when there is none.
  bool solve_around(const Goal& goal, const double* seed, Answer& out) const {
    const int n = size();
    double begun[kMaxLengths];
    std::memcpy(begun, seed, n * sizeof(double));
    feasible().pull(begun);
    Task task;
    descent_.evaluate(begun, goal, task);
    if (!(task.error < kMaxError)) return false;
    std::memcpy(out.lengths, begun, sizeof begun);
    out.residual = descent_.run_from(task, out.lengths, goal, out.iterations, &avoid_);
    out.starts = 1;
    const bool met = out.residual <= tuning().tolerance;
    if (met && avoid_.clear(feasible().sections, out.lengths)) return true;
    if (met && limits(goal, begun, out.lengths).starts == tuning().agreeing) return true;
    int order[kLibrary];
    library_order(goal, order);
    for (int k = 0; k < kAround && out.iterations < kAroundSteps; ++k) {
      double start[kMaxLengths];
      std::memcpy(start, library_[order[std::min(k * (k + 7) / 8, kLibrary - 1)]], sizeof start);
      const double left = descent_.run(start, goal, out.iterations, &avoid_);
      ++out.starts;
      if (left <= tuning().tolerance && avoid_.clear(feasible().sections, start)) {
        std::memcpy(out.lengths, start, sizeof start);
        out.residual = left;
        return true;
      }
    }
    return met;
  }

  static constexpr int kAround = 32;        // starts of the library
  static constexpr int kAroundSteps = 300;  // steps after which no other start is tried

  Descent descent_;
  Avoid avoid_;
  double library_[kLibrary][kMaxLengths];
  Frames frames_[kLibrary];

  const Tuning& tuning() const { return descent_.tuning; }

  // Newton steps of a start.
  int settling(const Goal& goal) const {
    return goal.rotation ? std::min(kBrief, tuning().settling) : tuning().settling;
  }

  void finish(Answer& out) const {
    out.converged = out.residual <= tuning().tolerance;
    std::fill(out.binding, out.binding + Answer::kWords, std::uint64_t{0});
    const LimitSet binding = feasible().binding(out.lengths);
    if constexpr (sizeof binding == sizeof *out.binding) {
      out.binding[0] = binding.to_ullong();
    } else {
      for (int k = 0; k < feasible().limits(); ++k)
        if (binding[k]) out.binding[k / 64] |= std::uint64_t{1} << k % 64;
    }
  }

  // Lengths from the closed forms, if they exist and are inside every limit.
  bool closed_form(const Goal& goal, double* lengths) const {
    const Sections& s = feasible().sections;
    double arcs[6];
    if (kColumns == 2) {  // the length of a section is given: no arc leads anywhere
      return false;
    } else if (goal.rotation) {
      return false;
    } else if (s.count == 1 && !goal.direction && !goal.mid) {
      if (!through(goal.tip, s.rigid[0], arcs)) return false;
    } else if (s.count == 2 && !goal.direction && goal.mid) {
      if (!two_arcs(goal.mid, goal.tip, s.rigid, arcs)) return false;
    } else {
      return false;
    }
    for (int i = 0; i < s.count; ++i) s.lengths(i, arcs + 3 * i, lengths);
    double sum = 0.0;  // not finite when a length is not: a target on the rim of what arcs can reach
    for (int i = 0; i < s.size(); ++i) sum += lengths[i];
    int number;
    return std::isfinite(sum) && feasible().worst(lengths, {}, number) <= kRounding;
  }

  // Few starts beyond the length of the arm, and few when the seed's descent followed a bounded optimum.
  SearchLimits limits(const Goal& goal, const double* begun, const double* found) const {
    constexpr int kAll = 2 * kLibrary;
    const double far = std::sqrt(dot(goal.tip, goal.tip, 3));
    double step = 0.0;
    for (int i = 0; i < size(); ++i) step = std::max(step, std::fabs(found[i] - begun[i]));
    return {far > feasible().longest() ? tuning().agreeing : kAll,
            step <= tuning().tracking * tuning().ell ? tuning().agreeing : kAll};
  }

  // One more start; true when the search can end: the target is met, or enough starts agree.
  bool try_start(double* start, Search& search, Answer& out) const {
    const double left = descent_.run(start, search.goal, out.iterations, nullptr, settling(search.goal));
    ++out.starts;
    // A clear gain only, so that rounding cannot make the answer jump between equal minima.
    if (left <= tuning().tolerance || left < 0.999 * out.residual) {
      std::memcpy(out.lengths, start, kMaxLengths * sizeof(double));
      out.residual = left;
      search.agreeing = 1;
    } else if (left < 1.001 * out.residual) {
      ++search.agreeing;
    }
    return out.residual <= tuning().tolerance || search.agreeing >= search.limits.agreeing ||
           out.starts >= search.limits.starts;
  }

  // The three biarcs that exceed the limits least, out of 64 control legs; true when the search can end.
  bool try_biarcs(Search& search, Answer& out) const {
    constexpr int kLegs = 64, kBest = 3;
    const Feasible& f = feasible();
    const int n = size();
    double score[kLegs], lengths[kLegs][6] = {};
    int order[kLegs], found = 0;
    const double scale = (f.home[0] + f.home[1] + f.home[2]) / 3.0;
    for (int k = 0; k < kLegs; ++k) {
      const double leg = 0.5 * scale * std::tan(0.5 * kPi * ((2.0 * k + 1.0) / kLegs - 1.0));
      double arcs[6];
      if (!biarc(search.goal.tip, search.goal.direction, leg, f.sections.rigid, arcs)) continue;
      double* l = lengths[found];
      for (int i = 0; i < 2; ++i) f.sections.lengths(i, arcs + 3 * i, l);
      double sum = 0.0;
      for (int m = 0; m < f.limits(); ++m) {
        const double over = f.excess(l, m);
        if (over > 0.0) sum += over * over;
      }
      double from_home = 0.0;
      for (int i = 0; i < n; ++i) from_home += (l[i] - f.home[i]) * (l[i] - f.home[i]);
      score[found] = sum + 1e-4 * from_home;
      order[found] = found;
      ++found;
    }
    nearest_first(score, order, found);
    for (int k = 0; k < std::min(found, kBest); ++k) {
      double start[kMaxLengths];
      std::memcpy(start, lengths[order[k]], n * sizeof(double));
      f.pull(start);
      if (try_start(start, search, out)) return true;
    }
    return false;
  }

  // Postures of the library whose task is nearest to the goal, then with growing strides.
  void try_library(Search& search, Answer& out) const {
    int order[kLibrary];
    library_order(search.goal, order);
    for (int k = 0; k < tuning().starts; ++k) {
      double start[kMaxLengths];
      std::memcpy(start, library_[order[std::min(k * (k + 7) / 8, kLibrary - 1)]], sizeof start);
      if (try_start(start, search, out)) return;
    }
  }

  void library_order(const Goal& goal, int* order) const {
    double distance[kLibrary];
    for (int k = 0; k < kLibrary; ++k) {
      const Frames& f = frames_[k];
      distance[k] = squared_distance(f.tip, goal.tip);
      if (goal.direction) {
        const double tangent[3] = {f.rotation[2], f.rotation[5], f.rotation[8]};
        distance[k] += tuning().ell * tuning().ell * squared_distance(tangent, goal.direction);
      }
      if (goal.rotation)
        for (int i = 0; i < 9; ++i) {
          const double off = tuning().ell * (f.rotation[i] - goal.rotation[i]);
          distance[k] += 0.5 * off * off;
        }
      if (goal.mid) distance[k] += squared_distance(f.mid, goal.mid);
      order[k] = k;
    }
    nearest_first(distance, order, kLibrary);
  }

  static void nearest_first(const double* distance, int* order, int count) {
    std::sort(order, order + count,
              [&](int a, int b) { return distance[a] < distance[b] || (distance[a] == distance[b] && a < b); });
  }
};

}  // namespace contid::section_build

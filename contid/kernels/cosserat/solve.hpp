// Inverse statics: bounded least squares on the task with equilibrium as a constraint.
//
//     minimise  |r(M, P)|^2 + weight |P - centre|^2   subject to   e(M, P) = 0,   P inside its limits
//
// Unknowns are the base moment M and the pressures P. The moment balance e is linearised and eliminated,
//
//     dM = -A^-1 (e + B dP),    r + J dP  with  J = D - C A^-1 B,
//
// so that an unreachable target never costs equilibrium. What is left is a Gauss-Newton step inside the limits and a
// trust box (box_step.hpp). The weight is 0 unless the task is redundant. A step must lower the cost |r|^2 + balance
// |e|^2; else the trust box shrinks. A descent from one start ends on the target in balance, where the step is below
// 1e-9 bar and predicts no gain (a bounded optimum), where the trust box has vanished, or after `iterations` sweeps
// with derivatives.
//
// Derivatives serve for further steps (chords) while these reduce the error tenfold, since a sweep without them costs
// less than half. The answer does not depend on it. A search tries track.hpp first.
#pragma once

#include <algorithm>

#include "box_step.hpp"
#include "branch.hpp"
#include "limits.hpp"
#include "task.hpp"

namespace contid {

constexpr double kCentreWeight = 1e-6, kStepTolerance = 1e-9, kFreedomTolerance = 1e-4, kTrustStart = 0.5,
                 kNullSpaceError = 0.3;
constexpr double kBalance = 1e-6;  // [N*mm], inside a descent
constexpr int kChords = 3;

struct Outcome {
  double pressures[kMost];
  Vec moment;
  double residual, statics;
  bool met, optimal, blocked;  // blocked: the last steps led out of the stable equilibria
  int iterations;
  Judged at;  // the last sweep; modes are -1 when not counted
};

// H = J^T J + weight + 1e-13 trace(J^T J): the last term keeps it definite for a redundant task.
template <int C>
void normal_matrix(int n, const double (&J)[9][C], int rows, double weight, double (&H)[kMost][kMost]) {
  double trace = 0.0;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j) {
      double sum = 0.0;
      for (int a = 0; a < rows; ++a) sum += J[a][i] * J[a][j];
      H[i][j] = H[j][i] = sum;
      if (i == j) trace += sum;
    }
  for (int i = 0; i < n; ++i) H[i][i] += weight + 1e-13 * trace;
}

// The task with the moment balance eliminated: dM = -A^-1 (e + B dP) leaves r + J dP with J = D - C A^-1 B.
struct Reduced {
  int n, rows;
  double by_both[9][kMostColumns];  // C and D: the task by (base moment, pressures)
  double J[9][kMost], H[kMost][kMost];
  double G[3][kMost];  // A^-1 B
  Mat inverse_A;

  // False where A, the balance by the base moment, is singular: at a critical load.
  bool eliminate(const Rod& rod, const Task& task, const Sweep& s, double weight) {
    n = rod.pressures(), rows = task.rows();
    jacobian(task, s, s.base + n, by_both);
    if (rod.arcs) return alone(weight);
    if (!inverse(first_columns(s.residual), inverse_A)) return false;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < n; ++j)
        G[i][j] = inverse_A.m[i][0] * s.residual[0][3 + j] + inverse_A.m[i][1] * s.residual[1][3 + j] +
                  inverse_A.m[i][2] * s.residual[2][3 + j];
    for (int a = 0; a < rows; ++a)
      for (int j = 0; j < n; ++j)
        J[a][j] = by_both[a][3 + j] - by_both[a][0] * G[0][j] - by_both[a][1] * G[1][j] - by_both[a][2] * G[2][j];
    normal_matrix(n, J, rows, weight, H);
    return true;
  }

  // Of a rod that carries nothing: there is no moment to eliminate.
  bool alone(double weight) {
    inverse_A = identity();
    keep_columns(by_both, 3, weight);
    return true;
  }

  // At a base moment that is known and stays: the task by the pressures alone.
  void at_moment(const Rod& rod, const Task& task, const Sweep& s, double weight) {
    double by_pressures[9][kMostColumns];
    n = rod.pressures(), rows = task.rows();
    jacobian(task, s, n, by_pressures);
    inverse_A = {};
    for (int a = 0; a < rows; ++a) std::fill(by_both[a], by_both[a] + 3, 0.0);
    keep_columns(by_pressures, 0, weight);
  }

  void keep_columns(const double (&by)[9][kMostColumns], int first, double weight) {
    for (int i = 0; i < 3; ++i) std::fill(G[i], G[i] + n, 0.0);
    for (int a = 0; a < rows; ++a) std::copy(by[a] + first, by[a] + first + n, J[a]);
    normal_matrix(n, J, rows, weight, H);
  }

  // r - damping C A^-1 e: the task error with the balance restored; Ge = A^-1 e.
  void ahead(const double* r, double damping, Vec Ge, double* out) const {
    for (int a = 0; a < rows; ++a)
      out[a] = r[a] - damping * (by_both[a][0] * Ge.x + by_both[a][1] * Ge.y + by_both[a][2] * Ge.z);
  }

  // -dM = damping A^-1 e + A^-1 B dP
  Vec moment_step(const double* d, double damping, Vec Ge) const {
    Vec turn = damping * Ge;
    for (int j = 0; j < n; ++j) turn = turn + d[j] * Vec{G[0][j], G[1][j], G[2][j]};
    return turn;
  }
};

// One descent from (start, moment).
inline Outcome solve(const Rod& rod, const Task& task, Vec tip_force, double share, const Limits& limits,
                     const double* start, Vec moment, int elements, double tolerance, int iterations) {
  const int n = rod.pressures();
  const int rows = task.rows();
  const double weight = task.independent() < n ? kCentreWeight : 0.0;
  const double none[3] = {0, 0, 0};
  const double reach2 = 0.5 * rod.reach * rod.reach * inflate(rod.sections[0], none).bend;
  const double balance = reach2 * reach2;

  Outcome out{};
  double* p = out.pressures;
  const bool carries = loaded(rod, tip_force);
  out.at.modes = -1;
  std::copy(start, start + n, p);
  clamp(limits, p);
  if (weight > 0.0) leave_axis(limits, p);

  const auto square = [](const double* r, int count) {
    double sum = 0.0;
    for (int i = 0; i < count; ++i) sum += r[i] * r[i];
    return sum;
  };
  const auto task_cost = [&](const double* r, Vec e) { return square(r, rows) + balance * dot(e, e); };
  const auto distance = [&](const double* at) {
    double away = 0.0;
    if (weight > 0.0)
      for (int i = 0; i < n; ++i) away += (at[i] - limits.centre[i]) * (at[i] - limits.centre[i]);
    return weight * away;
  };

  Sweep here;
  sweep(rod, p, moment, tip_force, share, elements, here);
  Reduced by;
  double r[9], ahead[9], g[kMost], low[kMost], high[kMost], d[kMost];
  out.at.ends = here.ends();
  residual(task, out.at.ends, r);
  double cost = task_cost(r, out.at.ends.moment), away = distance(p), trust = kTrustStart, damping = 1.0;
  Vec e = out.at.ends.moment;
  bool fresh = true;  // derivatives belong to the present point
  bool factored = false;
  int chords = 0;
  while (out.iterations < iterations) {
    if (!factored) {
      ++out.iterations;
      if (!by.eliminate(rod, task, here, weight)) break;
      out.at.tip_by_balance = first_columns(here.tip.by.shift) * by.inverse_A;
      out.at.mid_by_balance = first_columns(here.mid_shift) * by.inverse_A;
      factored = true;
    }
    // The secondary goal converges linearly where the task is strongly curved: only in the first half.
    const double pull = out.iterations <= iterations / 2 ? weight : 0.0;
    const Vec Ge = by.inverse_A * e;
    by.ahead(r, damping, Ge, ahead);
    for (int j = 0; j < n; ++j) {
      g[j] = pull * (p[j] - limits.centre[j]);
      for (int a = 0; a < rows; ++a) g[j] += by.J[a][j] * ahead[a];
      low[j] = std::max(limits.lower[j] - p[j], -trust);
      high[j] = std::min(limits.upper[j] - p[j], trust);
    }
    box_step(n, by.H, g, low, high, d);
    double size = 0.0;
    for (int j = 0; j < n; ++j) size = std::fmax(size, std::fabs(d[j]));
    const double error2 = square(r, rows);
    const bool balanced = norm(e) <= kBalance, good = error2 <= tolerance * tolerance;
    if (balanced && good && (pull == 0.0 || size <= kFreedomTolerance)) {
      out.optimal = true;
      break;
    }
    if (balanced && size <= kStepTolerance) {
      double predicted[9];
      for (int a = 0; a < rows; ++a) {
        predicted[a] = ahead[a];
        for (int j = 0; j < n; ++j) predicted[a] += by.J[a][j] * d[j];
      }
      if (square(predicted, rows) > 0.25 * error2) {
        if (fresh) {
          out.optimal = true;
          break;
        }
        sweep(rod, p, moment, tip_force, share, elements, here);
        fresh = true, factored = false, chords = 0;
        continue;
      }
    }
    double next[kMost];
    for (int j = 0; j < n; ++j) next[j] = std::min(std::max(p[j] + d[j], limits.lower[j]), limits.upper[j]);
    const Vec next_moment = moment - by.moment_step(d, damping, Ge);
    Judged trial = out.at;
    trial.modes = -1;
    if (carries && chords > 0) {
      // Probably the last one: count unstable modes along.
      judge(rod, next, next_moment, tip_force, share, elements, trial);
    } else {
      trial.ends = ends_of(rod, next, next_moment, tip_force, share, elements);
    }
    double next_r[9];
    residual(task, trial.ends, next_r);
    const double next_cost = task_cost(next_r, trial.ends.moment), next_away = distance(next);
    // In the null space of the task a straight step costs task error, which the next one removes.
    const bool sideways = pull > 0.0 && next_cost <= kNullSpaceError * kNullSpaceError && next_away < away;
    const bool better = next_cost + next_away < cost + away || (pull < weight && next_cost < cost);
    if (better || sideways || (size < 1e-6 && next_cost < cost + 1e-14)) {
      std::copy(next, next + n, p);
      std::copy(next_r, next_r + rows, r);
      moment = next_moment;
      e = trial.ends.moment;
      out.at = trial;
      const bool well = next_cost < 0.01 * cost;
      if (sideways || next_cost < 0.5 * cost) trust *= 2.0;
      cost = next_cost;
      away = next_away;
      damping = std::fmin(1.0, 2.0 * damping);
      fresh = false;
      const bool done = norm(e) <= kBalance && square(r, rows) <= tolerance * tolerance;
      if (done && weight == 0.0) {
        out.optimal = true;
        break;
      }
      if ((done || well) && ++chords <= kChords) continue;
      sweep(rod, p, moment, tip_force, share, elements, here);
      fresh = true, factored = false, chords = 0;
    } else if (!fresh) {
      sweep(rod, p, moment, tip_force, share, elements, here);
      fresh = true, factored = false, chords = 0;
    } else {
      trust = 0.3 * std::min(trust, std::max(size, 1e-12));
      damping *= 0.5;
      if (trust < 1e-12) break;
    }
  }
  out.statics = norm(e);
  out.residual = std::sqrt(square(r, rows));
  out.met = out.residual <= tolerance && out.statics <= kBalance;
  if (!out.met) {
    newton(rod, p, moment, tip_force, share, elements, here);
    out.at.ends = here.ends();
    out.at.modes = -1;
    residual(task, out.at.ends, r);
    out.statics = norm(here.moment);
    out.residual = std::sqrt(square(r, rows));
    out.met = out.residual <= tolerance && out.statics <= kBalance;
  }
  out.moment = moment;
  out.optimal = out.optimal || out.met;
  return out;
}

}  // namespace contid

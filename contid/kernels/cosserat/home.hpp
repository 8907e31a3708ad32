// Of all pressures that meet a redundant task the nearest to the centre.
//
//     minimise  1/2 |P - centre|^2   subject to   r(P) = 0,   P inside its limits
//
// Sequential quadratic programming from an answer on the target (Nocedal and Wright, Numerical Optimization, 2nd
// edition, chapter 18). Every iterate meets the task: a step minimises a quadratic model with the linearised task as an
// equation, chords bring it back onto the target. The metric is the identity at first; where steps do not shrink it
// becomes the second derivative of the Lagrangian, with the task's curvature. Long steps must lower the distance; short
// ones must lower it by more than rounding, or be shorter than the one before, because the derivatives of a sweep are
// those of the rod, not of its elements. It stops at a step below 1e-7 bar, so that an answer solved again from itself
// does not move, where no step is accepted any more, or after 100 steps.
#pragma once

#include "solve.hpp"

namespace contid {

constexpr int kHomeSteps = 100, kHomeChords = 16, kShifts = 16;
constexpr double kSettled = 1e-7, kExactTask = 1e-8, kExactBalance = 1e-8, kHomeNoise = 3e-3, kHomeContraction = 0.3,
                 kForward = 1e-4, kHomeGain = 1e-4, kHomeLast = 0.8, kHomeLeast = 1e-9, kHomeShrink = 0.25;

// Of the rows and columns that are free.
inline bool positive(int n, const double (&H)[kMost][kMost], const bool* free, double least) {
  double L[kMost][kMost];
  for (int i = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j) {
      double value = free[i] && free[j] ? H[i][j] : i == j ? 1.0 : 0.0;
      for (int k = 0; k < j; ++k) value -= L[i][k] * L[j][k];
      if (i == j && !(value > least)) return false;
      L[i][j] = i == j ? std::sqrt(value) : value / L[j][j];
    }
  return true;
}

struct Homing {
  const Rod& rod;
  const Task& task;
  Vec force;
  const Limits& limits;
  int elements;
  const int n = rod.pressures();

  struct Point {
    double p[kMost];
    Vec moment, e;
    Ends ends;
    double r[9];
  };

  double distance(const double* p) const {
    double sum = 0.0;
    for (int i = 0; i < n; ++i) sum += (p[i] - limits.centre[i]) * (p[i] - limits.centre[i]);
    return 0.5 * sum;
  }

  double task_error(const Point& at) const {
    double sum = 0.0;
    for (int a = 0; a < task.rows(); ++a) sum += at.r[a] * at.r[a];
    return std::sqrt(sum);
  }

  bool exact(const Point& at) const { return task_error(at) <= kExactTask && norm(at.e) <= kExactBalance; }

  // Where a sweep ends; with `judged`, with its unstable modes.
  void look(Point& there, Judged* judged) const {
    if (judged) {
      judge(rod, there.p, there.moment, force, 1.0, elements, *judged);
      there.ends = judged->ends;
    } else {
      there.ends = ends_of(rod, there.p, there.moment, force, 1.0, elements);
    }
    there.e = there.ends.moment;
    residual(task, there.ends, there.r);
  }

  // A step from `here`, then chords back onto the target; false where they do not get there.
  bool onto(const Reduced& by, const Point& here, const double* d, Point& there, Judged* judged = nullptr) const {
    double low[kMost], high[kMost], g[kMost], ahead[9], step[kMost], H[kMost][kMost];
    for (int j = 0; j < n; ++j) {
      step[j] = d[j];
      for (int i = 0; i < n; ++i) H[j][i] = by.H[j][i] + (i == j ? kCentreWeight : 0.0);
    }
    there = here;
    // Axes that the step brings to a limit stay there while enough others are free.
    bool held[kMost];
    int free = 0;
    for (int j = 0; j < n; ++j) {
      held[j] = here.p[j] + d[j] <= limits.lower[j] || here.p[j] + d[j] >= limits.upper[j];
      free += !held[j];
    }
    double before = std::numeric_limits<double>::infinity();
    for (int chord = 0; chord <= kHomeChords; ++chord) {
      const Vec turn = by.moment_step(step, 1.0, by.inverse_A * there.e);
      for (int j = 0; j < n; ++j)
        there.p[j] = std::min(std::max(there.p[j] + step[j], limits.lower[j]), limits.upper[j]);
      there.moment = there.moment - turn;
      look(there, judged);
      if (exact(there)) return true;
      const double error = task_error(there) + norm(there.e);
      if (!(error < 0.5 * before)) return false;
      before = error;
      by.ahead(there.r, 1.0, by.inverse_A * there.e, ahead);
      for (int j = 0; j < n; ++j) {
        g[j] = 0.0;
        for (int a = 0; a < by.rows; ++a) g[j] += by.J[a][j] * ahead[a];
        const bool stays = held[j] && free >= task.independent();
        low[j] = stays ? 0.0 : limits.lower[j] - there.p[j];
        high[j] = stays ? 0.0 : limits.upper[j] - there.p[j];
      }
      box_step(n, H, g, low, high, step);
    }
    return false;
  }

  // W = 1 + sum_a y_a d2 r_a / dp2 by forward differences, shifted until J^T J + weight W is positive definite.
  void curvature(const Reduced& by, const Point& here, const double* y, double (&W)[kMost][kMost]) const {
    double base[kMost];
    const auto pulled = [&](const Reduced& at, double* out) {
      for (int j = 0; j < n; ++j) {
        out[j] = 0.0;
        for (int a = 0; a < by.rows; ++a) out[j] += at.J[a][j] * y[a];
      }
    };
    pulled(by, base);
    double C[kMost][kMost];
    for (int k = 0; k < n; ++k) {
      double p[kMost], d[kMost] = {}, moved[kMost];
      std::copy(here.p, here.p + n, p);
      const double h = p[k] + kForward <= limits.upper[k] ? kForward : -kForward;
      p[k] += h, d[k] = h;
      Sweep there;
      sweep(rod, p, here.moment - by.moment_step(d, 1.0, by.inverse_A * here.e), force, 1.0, elements, there);
      Reduced at;
      if (at.eliminate(rod, task, there, 0.0))
        pulled(at, moved);
      else
        std::copy(base, base + n, moved);
      for (int j = 0; j < n; ++j) C[k][j] = (moved[j] - base[j]) / h;
    }
    double shift = 0.0;
    bool free[kMost];
    for (int j = 0; j < n; ++j) free[j] = here.p[j] > limits.lower[j] && here.p[j] < limits.upper[j];
    for (int attempt = 0; attempt <= kShifts; ++attempt) {
      double H[kMost][kMost];
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
          W[i][j] = 0.5 * (C[i][j] + C[j][i]) + (i == j ? 1.0 + shift : 0.0);
          H[i][j] = by.H[i][j] + kCentreWeight * W[i][j];
        }
      if (positive(n, H, free, 0.01 * kCentreWeight)) return;
      shift = shift == 0.0 ? 0.02 : 2.0 * shift;
    }
  }

  // The step of a quadratic model with H = J^T J + weight metric; y are the multipliers.
  void model_step(const Reduced& by, const double (&H)[kMost][kMost], const Point& here, double trust, double* y,
                  double* d) const {
    double g[kMost], low[kMost], high[kMost], ahead[9];
    by.ahead(here.r, 1.0, by.inverse_A * here.e, ahead);
    for (int j = 0; j < n; ++j) {
      low[j] = std::max(limits.lower[j] - here.p[j], -trust);
      high[j] = std::min(limits.upper[j] - here.p[j], trust);
    }
    FreeFactor factor;
    // The weight leaves a part of the error that the multipliers found so far remove.
    for (int pass = 0; pass < 2; ++pass) {
      for (int j = 0; j < n; ++j) {
        g[j] = kCentreWeight * (here.p[j] - limits.centre[j]);
        for (int a = 0; a < by.rows; ++a) g[j] += by.J[a][j] * (ahead[a] + kCentreWeight * y[a]);
      }
      box_step(n, H, g, low, high, d, factor);
      for (int a = 0; a < by.rows; ++a) {
        double closed = ahead[a];
        for (int j = 0; j < n; ++j) closed += by.J[a][j] * d[j];
        y[a] += closed / kCentreWeight;
      }
    }
  }

  // Settles an outcome that meets its target; one that is settled already stays as it is. Returns the steps taken.
  int run(Outcome& o) const {
    Point here;
    std::copy(o.pressures, o.pressures + n, here.p);
    leave_axis(limits, here.p);
    here.moment = o.moment;
    double W[kMost][kMost], H[kMost][kMost], d[kMost], y[9] = {};
    double trust = kTrustStart, last = std::numeric_limits<double>::infinity();
    bool arrived = true, bend = false, curved = false, fresh = false, left = false;
    Sweep at;
    Reduced by;
    int steps = 0;
    while (steps < kHomeSteps) {
      ++steps;
      if (arrived) {
        sweep(rod, here.p, here.moment, force, 1.0, elements, at);
        if (!by.eliminate(rod, task, at, 0.0)) break;
        here.ends = at.ends();
        here.e = here.ends.moment;
        residual(task, here.ends, here.r);
        if (left) keep(o, here);
        if (bend) curvature(by, here, y, W);
        curved = fresh = bend;
        arrived = false;
      }
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) H[j][i] = by.H[j][i] + kCentreWeight * (curved ? W[j][i] : i == j ? 1.0 : 0.0);
      model_step(by, H, here, trust, y, d);
      double size = 0.0, gain = 0.0;
      for (int j = 0; j < n; ++j) {
        size = std::fmax(size, std::fabs(d[j]));
        gain -= d[j] * (here.p[j] - limits.centre[j] + 0.5 * d[j]);
      }
      if (size <= kSettled) break;
      Point there;
      bool good = onto(by, here, d, there);
      // On the target a step must gain; a short one may be shorter than the one before instead, and away from a
      // saddle short steps grow.
      if (good && exact(here)) {
        const double nearer = distance(here.p) - distance(there.p);
        good =
            size > kHomeNoise ? nearer >= kHomeGain * std::fabs(gain) : size < kHomeLast * last || nearer > kHomeLeast;
      }
      if (good) {
        bend = curved || size > kHomeContraction * last;
        trust = std::fmax(trust, 2.0 * size);
        last = bend && !curved ? std::numeric_limits<double>::infinity() : size;
        here = there;
        arrived = left = true;
      } else if (!fresh) {
        curvature(by, here, y, W);
        curved = fresh = true;
        last = std::numeric_limits<double>::infinity();
      } else if (size > kHomeNoise) {
        trust = kHomeShrink * size;
      } else {
        break;
      }
    }
    return steps;
  }

  // Counting the unstable modes gives its derivatives by the balance.
  void keep(Outcome& o, const Point& here) const {
    std::copy(here.p, here.p + n, o.pressures);
    o.moment = here.moment;
    o.at.ends = here.ends;
    o.at.modes = -1;
    o.residual = task_error(here);
    o.statics = norm(here.e);
  }
};

}  // namespace contid

// Equilibrium of a rod by Newton's method on its virtual work; see rod.hpp. Compiled a second time for wider registers.
#include <algorithm>
#include <cmath>

#include "../arc/cholesky.hpp"
#include "../lu.hpp"
#include "element.hpp"
#include "rod.hpp"

namespace contid {

TendonRodSolver::TendonRodSolver(const RodSetup& setup)
    : s_(setup), free_(setup.stretches ? 4 : 3), size_(free_ * setup.elements) {
  const int n = s_.elements, m = s_.tendons;
  for (int e = 0; e < n; ++e) scale_ = std::max(scale_, s_.stiffness[4 * e]);
  for (State& state : states_) {
    state.x.resize(4 * n), state.left.resize(size_), state.matrix.resize(size_ * size_);
    state.points.resize(n + 1), state.frames.resize(n + 1), state.tension.resize(m), state.by_pull.resize(size_ * m);
    state.axes.resize(4 * n), state.shifts.resize(4 * n);
  }
  elements_.resize(n), forces_.resize(n), moments_.resize(n), outer_.resize(n), moved_.resize(4 * n);
  dl_.resize(4 * n * m), root_.resize(n * m), ratio_.resize(n * m);
  factor_.resize(size_ * size_), order_.resize(size_), right_.resize(size_ * (m + 3));
}

const TendonRodSolver::State* TendonRodSolver::solve(const double* pulls, Vec force, const double* start) {
  State *now = &states_[0], *next = &states_[1];
  std::copy(start, start + 4 * s_.elements, now->x.begin());
  balance(*now, pulls, force);
  for (int step = 0; step < kSteps; ++step) {
    if (now->size <= kExactRod * scale_) return now;
    for (int i = 0; i < size_; ++i) right_[i] = -now->left[i];
    if (!factorise(*now)) return nullptr;
    solve_factored(right_.data(), 1);
    double most = 1e-300;
    for (int i = 0; i < size_; ++i) most = std::max(most, std::fabs(right_[i]));
    if (!std::isfinite(most)) return nullptr;
    double share = std::min(1.0, kLargestTurn / most);
    for (;;) {
      for (int e = 0; e < s_.elements; ++e)
        for (int k = 0; k < 4; ++k)
          next->x[4 * e + k] = now->x[4 * e + k] + (k < free_ ? share * right_[free_ * e + k] : 0.0);
      balance(*next, pulls, force);
      if (next->size < (1.0 - 1e-4 * share) * now->size || share < 1e-4) break;
      share *= 0.5;
    }
    std::swap(now, next);
  }
  return now->size <= 1e4 * kExactRod * scale_ ? now : nullptr;
}

bool TendonRodSolver::stable(const State& at) {
  std::copy(at.matrix.begin(), at.matrix.end(), factor_.begin());
  return factor(factor_.data(), size_, size_);
}

bool TendonRodSolver::derivatives(const State& at, double* jacobian, double* compliance) {
  const int m = s_.tendons, columns = m + 3;
  for (int e = 0; e < s_.elements; ++e)
    for (int k = 0; k < free_; ++k) {
      const int i = free_ * e + k;
      const Vec by = cross(at.axes[4 * e + k], at.tip) + at.shifts[4 * e + k];
      for (int j = 0; j < m; ++j) right_[i * columns + j] = -at.by_pull[i * m + j];
      right_[i * columns + m] = by.x, right_[i * columns + m + 1] = by.y, right_[i * columns + m + 2] = by.z;
    }
  if (!factorise(at)) return false;
  solve_factored(right_.data(), columns);
  std::fill(jacobian, jacobian + 3 * m, 0.0);
  std::fill(compliance, compliance + 9, 0.0);
  for (int e = 0; e < s_.elements; ++e)
    for (int k = 0; k < free_; ++k) {
      const double* row = &right_[(free_ * e + k) * columns];
      const Vec by = cross(at.axes[4 * e + k], at.tip) + at.shifts[4 * e + k];
      const double tip[3] = {by.x, by.y, by.z};
      for (int a = 0; a < 3; ++a) {
        for (int j = 0; j < m; ++j) jacobian[a * m + j] += tip[a] * row[j];
        for (int b = 0; b < 3; ++b) compliance[3 * a + b] += tip[a] * row[m + b];
      }
    }
  return true;
}

void TendonRodSolver::balance(State& at, const double* pulls, Vec force) {
  const int n = s_.elements;
  at.points[0] = {0.0, 0.0, s_.base};
  at.frames[0] = identity();
  for (int e = 0; e < n; ++e) {
    LocalElement& local = elements_[e];
    local = local_element(&at.x[4 * e], s_.h[e]);
    const Mat& R = at.frames[e];
    for (int k = 0; k < 4; ++k) {
      at.axes[4 * e + k] = R * local.spin[k];
      at.shifts[4 * e + k] = R * local.shift[k] + cross(at.points[e], at.axes[4 * e + k]);
    }
    at.points[e + 1] = at.points[e] + R * (local.end + s_.rigid[e] * column(local.turn, 2));
    at.frames[e + 1] = R * local.turn;
  }
  at.tip = at.points[n] + at.frames[n] * s_.offset;
  loads(at, force);
  tendons(at, pulls);
  geometric(at);
  at.size = 0.0;
  for (int i = 0; i < size_; ++i) at.size += at.left[i] * at.left[i];
  at.size = std::sqrt(at.size);
}

void TendonRodSolver::loads(const State& at, Vec force) {
  const int n = s_.elements;
  Vec sum = force, moment = cross(at.tip, force);
  Mat outer = product_of(at.tip, force);
  for (int e = n - 1; e >= 0; --e) {
    // Half of an element's weight is at each of its ends.
    const Vec here = 0.5 * (s_.weight[e] + (e + 1 < n ? s_.weight[e + 1] : Vec{0, 0, 0}));
    sum = sum + here;
    moment = moment + cross(at.points[e + 1], here);
    add(outer, product_of(at.points[e + 1], here));
    forces_[e] = sum, moments_[e] = moment, outer_[e] = outer;
  }
}

void TendonRodSolver::tendons(State& at, const double* pulls) {
  const int n = s_.elements, m = s_.tendons;
  double shortening[kMaxTendons] = {}, stiff[kMaxTendons];
  for (int e = 0; e < n; ++e) {
    const double *x = &at.x[4 * e], h = s_.h[e];
    for (int j = 0; j < m; ++j) {
      const TendonPiece piece = tendon_piece(x, h, &s_.arms[2 * (e * m + j)]);
      root_[e * m + j] = piece.root, ratio_[e * m + j] = piece.ratio;
      std::copy(piece.by, piece.by + 4, &dl_[4 * (e * m + j)]);
      shortening[j] += piece.shortening;
    }
  }
  for (int j = 0; j < m; ++j) {
    const double tension = s_.rest[j] + s_.tendon[j] * (pulls[j] - shortening[j]);
    at.tension[j] = std::max(tension, 0.0);
    stiff[j] = tension > 0.0 ? s_.tendon[j] : 0.0;
  }
  for (int e = 0; e < n; ++e)
    for (int k = 0; k < free_; ++k) {
      const int i = free_ * e + k;
      double work = s_.stiffness[4 * e + k] * at.x[4 * e + k];
      work -= dot(at.axes[4 * e + k], moments_[e]) + dot(at.shifts[4 * e + k], forces_[e]);
      for (int j = 0; j < m; ++j) {
        const double by = dl_[4 * (e * m + j) + k];
        work += at.tension[j] * by;
        at.by_pull[i * m + j] = stiff[j] * by;
      }
      at.left[i] = work;
    }
  double column[kMaxTendons];
  for (int f = 0; f < n; ++f)
    for (int l = 0; l < free_; ++l) {
      for (int j = 0; j < m; ++j) column[j] = dl_[4 * (f * m + j) + l];
      const int c = free_ * f + l;
      for (int i = 0; i <= c; ++i) {
        const double* row = &at.by_pull[i * m];
        double sum = 0.0;
        for (int j = 0; j < m; ++j) sum += row[j] * column[j];
        at.matrix[i * size_ + c] = sum;
      }
    }
  for (int i = 0; i < size_; ++i)
    for (int c = 0; c < i; ++c) at.matrix[i * size_ + c] = at.matrix[c * size_ + i];
  for (int e = 0; e < n; ++e) own_tendons(at, e);
}

void TendonRodSolver::own_tendons(State& at, int e) {
  const int m = s_.tendons;
  const double h = s_.h[e], twist = at.x[4 * e + 2];
  double own[4][4] = {};
  for (int j = 0; j < m; ++j) {
    const double *arm = &s_.arms[2 * (e * m + j)], root = root_[e * m + j], ratio = ratio_[e * m + j];
    if (std::isnan(arm[0])) continue;
    const double tension = at.tension[j];
    const double squared = (arm[0] * arm[0] + arm[1] * arm[1]) / (h * h);
    const double by_along = tension * h * squared * twist * twist / (root * root * root);
    const double mixed = -tension * h * ratio * squared * twist / (root * root);
    const double along[4] = {-arm[0] / h, -arm[1] / h, 0.0, 1.0};
    for (int k = 0; k < 4; ++k) {
      for (int l = 0; l < 4; ++l) own[k][l] += by_along * along[k] * along[l];
      own[k][2] += mixed * along[k], own[2][k] += mixed * along[k];
    }
    own[2][2] += tension * h * squared * ratio * ratio / root;
  }
  for (int k = 0; k < free_; ++k) {
    own[k][k] += s_.stiffness[4 * e + k];
    for (int l = 0; l < free_; ++l) entry(at, e, k, e, l) += own[k][l];
  }
}

void TendonRodSolver::geometric(State& at) {
  const int n = s_.elements;
  for (int e = 0; e < n; ++e) {
    const Mat& outer = outer_[e];
    const double trace = outer.m[0][0] + outer.m[1][1] + outer.m[2][2];
    for (int k = 0; k < free_; ++k)
      moved_[4 * e + k] =
          cross(at.shifts[4 * e + k], forces_[e]) + outer * at.axes[4 * e + k] - trace * at.axes[4 * e + k];
  }
  for (int e = 0; e < n; ++e) {
    for (int k = 0; k < free_; ++k)
      for (int f = e + 1; f < n; ++f)
        for (int l = 0; l < free_; ++l) {
          const double value = dot(at.axes[4 * e + k], moved_[4 * f + l]);
          entry(at, e, k, f, l) -= value;
          entry(at, f, l, e, k) -= value;
        }
    const LocalElement& local = elements_[e];
    const Mat& R = at.frames[e];
    const Vec moment = transposed_times(R, moments_[e] - cross(at.points[e], forces_[e]));
    const Vec force = transposed_times(R, forces_[e]);
    for (int k = 0; k < free_; ++k)
      for (int l = 0; l < free_; ++l)
        entry(at, e, k, e, l) -= dot(at.axes[4 * e + k], moved_[4 * e + l]) + dot(local.spin_by[l][k], moment) +
                                 dot(local.shift_by[l][k], force);
  }
}

bool TendonRodSolver::factorise(const State& at) {
  std::copy(at.matrix.begin(), at.matrix.end(), factor_.begin());
  return factorise_lu(factor_.data(), order_.data(), size_);
}

void TendonRodSolver::solve_factored(double* right, int columns) const {
  solve_lu(factor_.data(), order_.data(), size_, right, columns);
}

}  // namespace contid

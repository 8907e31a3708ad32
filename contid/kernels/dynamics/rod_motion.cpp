// See rod_motion.hpp for the equations.
#include "rod_motion.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "../arc/cholesky.hpp"
#include "../lu.hpp"
#include "../tendon/element.hpp"

namespace contid {

namespace {

constexpr int kNewton = 12;           // iterations of a step
constexpr double kExact = 1e-9;       // last change of a strain in a step [rad]
constexpr int kHalvings = 6;          // of a step
constexpr int kRenewals = 3;          // of a step's matrix, where tendons become taut or slack within it
constexpr int kSettling = 200;        // iterations for an equilibrium
constexpr double kLargestTurn = 0.3;  // of an element in one of them [rad]
constexpr double kBalanced = 1e-12;   // moments left over that end the search, as a share of the greatest stiffness
constexpr double kAtRest = 1e-8;      // and those of an equilibrium: sums of many elements are rounded
constexpr double kLeastShare = 1e-4;  // of a change of the strains
constexpr double kDifference = 1e-6;  // of a strain, for derivatives of the balance

double cube(double x) { return x * x * x; }

}  // namespace

RodMotion::RodMotion(MotionSetup setup)
    : s_(std::move(setup)), per_(s_.strains), size_(per_ * s_.elements), now_(s_.elements), next_(s_.elements) {
  const int n = s_.elements;
  stiffness = strain = std::vector<double>(kMaxStrains * n, 0.0);
  momentum.assign(size_, 0.0), tensions.assign(s_.tendons, 0.0);
  loads.nodes.resize(n), loads.strains.assign(kMaxStrains * n, 0.0), loads.pulls.assign(s_.tendons, 0.0);
  last_.assign(size_, 0.0), trial_ = middle_ = strain;
  right_.resize(size_), force_.resize(size_), matrix_.resize(size_ * size_), mass_ = matrix_, base_.resize(size_);
  dl_.resize(size_ * std::max(1, s_.tendons)), weights_.resize(s_.tendons);
  pulls_.assign(s_.tendons, Pull::SLACK), assumed_ = pulls_;
  held_.assign(s_.tendons, 0.0), pull_ = pull_rate_ = held_;
  for (Placed* p : {&now_, &next_}) p->frames[0] = identity(), p->points[0] = {0.0, 0.0, s_.base};
  place(strain.data(), s_.lengths, s_.rigid, per_, now_);
}

void RodMotion::put(const double* strains) {
  std::copy(strains, strains + strain.size(), strain.begin());
  std::fill(momentum.begin(), momentum.end(), 0.0);
  std::fill(last_.begin(), last_.end(), 0.0);
  place(strain.data(), s_.lengths, s_.rigid, per_, now_);
  fresh_ = true;
}

bool RodMotion::step(double h) {
  if (fresh_) hold_pulls();
  const double within = std::max(h, loads.reached_in_s);
  for (int j = 0; j < s_.tendons; ++j) pull_rate_[j] = (loads.pulls[j] - held_[j]) / within;
  const bool found = advance(h, 0);
  loads.reached_in_s = std::max(0.0, loads.reached_in_s - h);
  if (within <= h * (1.0 + 1e-9)) held_ = loads.pulls, loads.reached_in_s = 0.0;
  return found;
}

bool RodMotion::advance(double h, int depth) {
  if (solve(h)) return true;
  if (depth == kHalvings) return false;
  // The last change was that of a longer step.
  for (double& each : last_) each *= 0.5;
  return advance(0.5 * h, depth + 1) && advance(0.5 * h, depth + 1);
}

bool RodMotion::solve(double h) {
  const int n = s_.elements;
  for (int j = 0; j < s_.tendons; ++j) pull_[j] = held_[j] + 0.5 * h * pull_rate_[j];
  external(now_, force_.data());
  for (int i = 0; i < size_; ++i) base_[i] = momentum[i] + 0.5 * h * force_[i];
  spread(last_.data(), 1.0, trial_.data());
  std::fill(mass_.begin(), mass_.end(), 0.0);
  mass(now_, 1.0 / h, mass_.data());
  const auto renew = [&] {
    matrix_ = mass_;
    add_curvature(middle_.data(), h, matrix_.data());
    for (int e = 0; e < n; ++e)
      for (int k = 0; k < per_; ++k) {
        const int i = index(e, k);
        matrix_[i * size_ + i] += 0.5 * damping_s * stiffness[kMaxStrains * e + k] + slow(e, k, h);
      }
    assumed_ = pulls_;
    return factor_rows(matrix_.data(), size_);
  };
  spread(last_.data(), 0.5, middle_.data());
  gradient(middle_.data(), force_.data());
  damp_tendons(h);
  if (!renew()) return false;
  int renewals = 0;
  double change = 0.0;
  for (int round = 0; round < kNewton; ++round) {
    place(trial_.data(), s_.lengths, s_.rigid, per_, next_);
    moved(now_, now_, next_, 1.0 / h, right_.data());
    for (std::size_t i = 0; i < strain.size(); ++i) middle_[i] = 0.5 * (strain[i] + trial_[i]);
    gradient(middle_.data(), force_.data());
    damp_tendons(h);
    if (pulls_ != assumed_ && renewals++ < kRenewals && !renew()) return false;
    for (int e = 0; e < n; ++e)
      for (int k = 0; k < per_; ++k) {
        const int i = index(e, k), j = kMaxStrains * e + k;
        // What pulls back: the same in both equations.
        force_[i] = 0.5 * h * force_[i] + 0.5 * damping_s * stiffness[j] * (trial_[j] - strain[j]);
        right_[i] = base_[i] - right_[i] - force_[i] - slow(e, k, h) * (trial_[j] - strain[j]);
      }
    if (round > 0 && change <= kExact) break;
    solve_rows(matrix_.data(), size_, right_.data());
    change = 0.0;
    for (int i = 0; i < size_; ++i) change = std::max(change, std::fabs(right_[i]));
    if (!(change < 1.0)) return false;
    for (int e = 0; e < n; ++e)
      for (int k = 0; k < per_; ++k) trial_[kMaxStrains * e + k] += right_[index(e, k)];
    if (round == kNewton - 1 && change > 1e3 * kExact) return false;
  }
  moved(next_, now_, next_, 1.0 / h, right_.data());
  external(next_, base_.data());
  for (int e = 0; e < n; ++e)
    for (int k = 0; k < per_; ++k) {
      const int i = index(e, k), j = kMaxStrains * e + k;
      momentum[i] = right_[i] - force_[i] + 0.5 * h * base_[i] + slow(e, k, h) * (trial_[j] - strain[j]);
      last_[i] = trial_[j] - strain[j];
    }
  for (int j = 0; j < s_.tendons; ++j) held_[j] += h * pull_rate_[j];
  std::swap(strain, trial_);
  std::swap(now_, next_);
  return true;
}

bool RodMotion::settle() {
  hold_pulls();
  const std::vector<double> began = strain;
  double most = 0.0;
  for (int e = 0; e < s_.elements; ++e) most = std::max(most, stiffness[kMaxStrains * e]);
  std::vector<double> left(size_), way(size_), by(size_ * size_);
  std::vector<int> order(size_);
  const auto balance = [&](std::vector<double>& out) {
    place(strain.data(), s_.lengths, s_.rigid, per_, now_);
    gradient(strain.data(), out.data());
    external(now_, force_.data());
    double sum = 0.0;
    for (int i = 0; i < size_; ++i) out[i] -= force_[i], sum += out[i] * out[i];
    return std::sqrt(sum);
  };
  double size = balance(left);
  for (int round = 0; round < kSettling && size > kBalanced * most; ++round) {
    differentiate(by.data());
    if (!factorise_lu(by.data(), order.data(), size_)) break;
    way = left;
    solve_lu(by.data(), order.data(), size_, way.data(), 1);
    double turn = 1e-300;
    for (double each : way) turn = std::max(turn, std::fabs(each));
    const std::vector<double> from = strain;
    const double before = size;
    for (double share = std::min(1.0, kLargestTurn / turn); share > kLeastShare; share *= 0.5) {
      for (int e = 0; e < s_.elements; ++e)
        for (int k = 0; k < per_; ++k)
          strain[kMaxStrains * e + k] = from[kMaxStrains * e + k] - share * way[index(e, k)];
      size = balance(left);
      if (size < (1.0 - 1e-3 * share) * before) break;
    }
    if (!(size < before)) break;
  }
  if (size <= kAtRest * most) {
    std::fill(momentum.begin(), momentum.end(), 0.0);
    std::fill(last_.begin(), last_.end(), 0.0);
    return true;
  }
  strain = began;
  place(strain.data(), s_.lengths, s_.rigid, per_, now_);
  return false;
}

double RodMotion::kinetic() {
  std::fill(matrix_.begin(), matrix_.end(), 0.0);
  mass(now_, 1.0, matrix_.data());
  std::vector<double> rate = momentum;
  if (!factor_rows(matrix_.data(), size_)) return NAN;
  solve_rows(matrix_.data(), size_, rate.data());
  double sum = 0.0;
  for (int i = 0; i < size_; ++i) sum += 0.5 * rate[i] * momentum[i];
  return sum;
}

double RodMotion::potential() {
  const int n = s_.elements, m = s_.tendons;
  double sum = 0.0;
  pull_ = fresh_ ? loads.pulls : held_;
  gradient(strain.data(), right_.data());  // the tensions
  for (int j = 0; j < m; ++j) sum += 0.5 * tensions[j] * tensions[j] / s_.tendon[j];
  for (int e = 0; e < n; ++e) {
    for (int k = 0; k < per_; ++k) {
      const double x = strain[kMaxStrains * e + k];
      sum += (0.5 * stiffness[kMaxStrains * e + k] * x - loads.strains[kMaxStrains * e + k]) * x;
    }
    sum -= s_.middles[e].mass * dot(loads.gravity, now_.middles[e].at);
    sum -= s_.ends[e].mass * dot(loads.gravity, now_.ends[e].at) + dot(loads.nodes[e].force, now_.ends[e].at);
  }
  return sum;
}

void RodMotion::linearise(double* mass_out, double* stiffness_out) {
  std::fill(mass_out, mass_out + size_ * size_, 0.0);
  mass(now_, 1.0, mass_out);
  differentiate(stiffness_out);
}

void RodMotion::differentiate(double* stiffness_out) {
  pull_ = loads.pulls;
  std::vector<double> x = strain, low(size_), high(size_), force(size_);
  for (int e = 0; e < s_.elements; ++e)
    for (int k = 0; k < per_; ++k) {
      const int j = kMaxStrains * e + k, c = index(e, k);
      for (double sign : {-1.0, 1.0}) {
        x[j] = strain[j] + sign * kDifference;
        place(x.data(), s_.lengths, s_.rigid, per_, next_);
        std::vector<double>& out = sign < 0.0 ? low : high;
        gradient(x.data(), out.data());
        external(next_, force.data());
        for (int i = 0; i < size_; ++i) out[i] -= force[i];
      }
      x[j] = strain[j];
      for (int i = 0; i < size_; ++i) stiffness_out[i * size_ + c] = (high[i] - low[i]) / (2.0 * kDifference);
    }
}

void RodMotion::moved(const Placed& at, const Placed& from, const Placed& to, double scale, double* out) {
  const int n = s_.elements;
  Wrench6 beyond;
  for (int e = n - 1; e >= 0; --e) {
    add(beyond, contid::momentum(s_.ends[e], at.ends[e], to.ends[e] - from.ends[e]));
    const Wrench6 middle = contid::momentum(s_.middles[e], at.middles[e], to.middles[e] - from.middles[e]);
    for (int k = 0; k < per_; ++k) {
      const int j = kMaxStrains * e + k;
      out[index(e, k)] = scale * (work(at.whole[j], beyond) + work(at.half[j], middle));
    }
    add(beyond, middle);
  }
}

void RodMotion::external(const Placed& at, double* out) {
  const auto weighing = [&](const Inertia& i, const Body& b) {
    const Vec weight = i.mass * loads.gravity;
    return Wrench6{weight, cross(b.at, weight)};
  };
  Wrench6 beyond;
  for (int e = s_.elements - 1; e >= 0; --e) {
    const Wrench6& node = loads.nodes[e];
    add(beyond, {node.force, node.moment + cross(at.ends[e].at, node.force)});
    add(beyond, weighing(s_.ends[e], at.ends[e]));
    const Wrench6 middle = weighing(s_.middles[e], at.middles[e]);
    for (int k = 0; k < per_; ++k) {
      const int j = kMaxStrains * e + k;
      out[index(e, k)] = work(at.whole[j], beyond) + work(at.half[j], middle);
    }
    add(beyond, middle);
  }
}

// Derivative of the strains' energy; also the tensions and, for add_curvature, the derivatives of the tendons' lengths.
void RodMotion::gradient(const double* x, double* out) {
  const int n = s_.elements, m = s_.tendons;
  for (int e = 0; e < n; ++e)
    for (int k = 0; k < per_; ++k) {
      const int j = kMaxStrains * e + k;
      out[index(e, k)] = stiffness[j] * x[j] - loads.strains[j];
    }
  if (m == 0) return;
  std::fill(tensions.begin(), tensions.end(), 0.0);
  for (int e = 0; e < n; ++e) {
    const double *strains = x + kMaxStrains * e, h = s_.lengths[e];
    for (int j = 0; j < m; ++j) {
      const TendonPiece piece = tendon_piece(strains, h, &s_.arms[2 * (e * m + j)]);
      for (int k = 0; k < std::min(per_, 4); ++k) dl_[index(e, k) * m + j] = piece.by[k];
      tensions[j] += piece.shortening;  // so far
    }
  }
  for (int j = 0; j < m; ++j) tensions[j] = std::max(0.0, s_.rest[j] + s_.tendon[j] * (pull_[j] - tensions[j]));
  for (int i = 0; i < size_; ++i)
    for (int j = 0; j < m; ++j) out[i] += tensions[j] * dl_[i * m + j];
}

// Tendons that pull are damped as the backbone is: a tension of the damping time and stiffness times the rate at which
// they are stretched, up to the tension of the spring. A tendon that tightens has no tension all at once then, which
// would leave steps without an answer.
void RodMotion::damp_tendons(double h) {
  for (int j = 0; j < s_.tendons; ++j) {
    pulls_[j] = Pull::SLACK;
    if (!(tensions[j] > 0.0)) continue;
    double longer = h * pull_rate_[j];
    for (int e = 0; e < s_.elements; ++e)
      for (int k = 0; k < per_; ++k)
        longer += dl_[index(e, k) * s_.tendons + j] * (trial_[kMaxStrains * e + k] - strain[kMaxStrains * e + k]);
    const double rate = damping_s * s_.tendon[j] * longer / h, more = std::clamp(rate, -tensions[j], tensions[j]);
    pulls_[j] = more == rate ? Pull::DAMPED : more > 0.0 ? Pull::DOUBLED : Pull::EASED;
    for (int i = 0; i < size_; ++i) force_[i] += more * dl_[i * s_.tendons + j];
    tensions[j] += more;
  }
}

// Second derivative of the strains' energy. A tendon of the length h sqrt(a^2 + s t^2) in its element, with a linear in
// the strains and the twist t, has the second derivative h s / root^3 v v^T there, v = t a' - a t'.
// The gradient at x comes before, and damp_tendons().
void RodMotion::add_curvature(const double* x, double h, double* matrix) {
  const int m = s_.tendons;
  const double scale = 0.25 * h;
  for (int e = 0; e < s_.elements; ++e)
    for (int k = 0; k < per_; ++k) {
      const int i = index(e, k);
      matrix[i * size_ + i] += scale * stiffness[kMaxStrains * e + k];
    }
  if (m == 0) return;
  for (int j = 0; j < m; ++j) {
    const bool damped = pulls_[j] == Pull::DAMPED, doubled = pulls_[j] == Pull::DOUBLED;
    weights_[j] = s_.tendon[j] * (damped ? scale + 0.5 * damping_s : doubled ? 2.0 * scale : 0.0);
  }
  for (int i = 0; i < size_; ++i)
    for (int c = 0; c <= i; ++c) {
      double sum = 0.0;
      for (int j = 0; j < m; ++j) sum += weights_[j] * dl_[i * m + j] * dl_[c * m + j];
      matrix[i * size_ + c] += sum;
      if (c != i) matrix[c * size_ + i] += sum;
    }
  for (int e = 0; e < s_.elements; ++e)
    for (int j = 0; j < m; ++j) {
      const double *arm = &s_.arms[2 * (e * m + j)], *strains = x + kMaxStrains * e, l = s_.lengths[e];
      if (!(tensions[j] > 0.0) || std::isnan(arm[0])) continue;
      const TendonPiece piece = tendon_piece(strains, l, arm);
      const double along = piece.ratio * piece.root, twist = strains[2];
      const double weight = scale * tensions[j] * (arm[0] * arm[0] + arm[1] * arm[1]) / (l * cube(piece.root));
      const double v[4] = {-twist * arm[0] / l, -twist * arm[1] / l, -along, twist};
      for (int k = 0; k < std::min(per_, 4); ++k)
        for (int c = 0; c < std::min(per_, 4); ++c) matrix[index(e, k) * size_ + index(e, c)] += weight * v[k] * v[c];
    }
}

void RodMotion::mass(const Placed& at, double scale, double* matrix) {
  Together beyond;
  for (int f = s_.elements - 1; f >= 0; --f) {
    beyond.add(s_.ends[f], at.ends[f]);
    Together middle;
    middle.add(s_.middles[f], at.middles[f]);
    for (int l = 0; l < per_; ++l) {
      const int j = kMaxStrains * f + l, c = index(f, l);
      const Wrench6 whole = beyond.times(at.whole[j]), half = middle.times(at.half[j]);
      for (int k = 0; k <= l; ++k) {
        const int own = kMaxStrains * f + k, i = index(f, k);
        const double value = scale * (work(at.whole[own], whole) + work(at.half[own], half));
        matrix[i * size_ + c] += value;
        if (i != c) matrix[c * size_ + i] += value;
      }
      const Wrench6 both{whole.force + half.force, whole.moment + half.moment};
      for (int e = 0; e < f; ++e)
        for (int k = 0; k < per_; ++k) {
          const double value = scale * work(at.whole[kMaxStrains * e + k], both);
          matrix[index(e, k) * size_ + c] += value;
          matrix[c * size_ + index(e, k)] += value;
        }
    }
    beyond.add(s_.middles[f], at.middles[f]);
  }
}

void RodMotion::spread(const double* free, double share, double* strains) const {
  for (int e = 0; e < s_.elements; ++e)
    for (int k = 0; k < per_; ++k) {
      const int j = kMaxStrains * e + k;
      strains[j] = strain[j] + share * free[index(e, k)];
    }
}

}  // namespace contid

// Pythagorean-hodograph quintics and tube lengths along them: the compiled twin of contid/models/ph_*.py,
// which is the specification and says where each equation comes from. No allocation, no exceptions.
#pragma once

#include <array>
#include <cmath>
#include <limits>

namespace contid::ph {

using Vec = std::array<double, 3>;
using Quat = std::array<double, 4>;  // scalar, i, j, k

constexpr int max_sections = 8;
constexpr int max_tubes = 8;
constexpr int panels = 8;
constexpr double no_turn = 1e-12;
constexpr double underflow = 1e-150;
constexpr double straight = 1e-10;
constexpr double dear = 2.0;
constexpr double small = 1.0;

inline double dot(const Vec& a, const Vec& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline double dot(const Quat& a, const Quat& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

// <A, B> = (A i B* + B i A*) / 2
inline Vec product(const Quat& a, const Quat& b) {
  return {a[0] * b[0] + a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
          a[0] * b[3] + a[3] * b[0] + a[1] * b[2] + a[2] * b[1],
          a[1] * b[3] + a[3] * b[1] - a[0] * b[2] - a[2] * b[0]};
}

inline Quat times_i(const Quat& a) { return {-a[1], a[0], a[3], -a[2]}; }

inline Quat turned(const Quat& a, double cosine, double sine) {
  const Quat b = times_i(a);
  return {a[0] * cosine + b[0] * sine, a[1] * cosine + b[1] * sine, a[2] * cosine + b[2] * sine,
          a[3] * cosine + b[3] * sine};
}

inline Quat lift(const Vec& d) {
  const double size = std::sqrt(dot(d, d));
  if (size == 0.0) return {0.0, 0.0, 0.0, 0.0};
  const double x = d[0] / size, y = d[1] / size, z = d[2] / size;
  const double off = std::hypot(y, z);
  if (x < 0.0 && off < underflow) return {0.0, 0.0, std::sqrt(size), 0.0};
  const double one_plus_x = x > 0.0 ? 1.0 + x : off * (off / (1.0 - x));
  const double scale = std::sqrt(size) / std::hypot(one_plus_x, off);
  return {0.0, scale * one_plus_x, scale * y, scale * z};
}

// b turned to be nearest to a.
inline Quat nearest(const Quat& b, const Quat& a, const Vec& hint) {
  double cosine = dot(b, a), sine = dot(times_i(b), a);
  double size = std::hypot(cosine, sine);
  if (size <= no_turn * std::sqrt(dot(a, a) * dot(b, b))) {
    cosine = dot(product(a, b), hint);
    sine = dot(product(a, times_i(b)), hint);
    size = std::hypot(cosine, sine);
    if (size == 0.0) return b;
  }
  return turned(b, cosine / size, sine / size);
}

struct Fit {
  std::array<Quat, 3> preimage;
  double end_speed;
  double length;
  bool length_met;
};

inline double speed_for_length(const Vec& chord, const Vec& G, double k, double length) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  const double K = 30.0 - 10.0 * k, chord2 = dot(chord, chord);
  const double surplus = (length - std::sqrt(chord2)) / length;
  if (surplus < -straight) return nan;
  if (1.0 - k < straight && surplus < straight) return length;
  const double c2 = dot(G, G) - K * K;
  const double c1 = 240.0 * (dot(chord, G) + length * K);
  const double c0 = 14400.0 * (chord2 - length * length);
  const double discriminant = c1 * c1 - 4.0 * c2 * c0;
  if (discriminant < 0.0) return nan;
  const double below = c1 + std::sqrt(discriminant);
  const double m = below > 0.0 ? -2.0 * c0 / below : nan;
  return m > 0.0 && 120.0 * length >= m * K * (1.0 - straight) ? m : nan;
}

inline double speed_as_mean(const Vec& chord, const Vec& G, double k) {
  const double c2 = dot(G, G) - (90.0 + 10.0 * k) * (90.0 + 10.0 * k);
  const double c1 = 240.0 * dot(chord, G), c0 = 14400.0 * dot(chord, chord);
  const double root = std::sqrt(c1 * c1 - 4.0 * c2 * c0);
  return c1 >= 0.0 ? (-c1 - root) / (2.0 * c2) : 2.0 * c0 / (root - c1);
}

// Curve over `chord` between unit tangents; `length` is NaN when it is not known.
inline Fit through(const Vec& chord, const Vec& t0, const Vec& t1, double length, double beta, double gamma) {
  const double cos_beta = std::cos(beta), sin_beta = std::sin(beta);
  const Quat u0 = lift(t0);
  const Quat u2 = turned(nearest(lift(t1), u0, chord), cos_beta, sin_beta);
  const double k = dot(u0, u2);
  const Vec middle = product(u0, u2);
  Vec G;
  for (int i = 0; i < 3; ++i) G[i] = 10.0 * middle[i] - 15.0 * (t0[i] + t1[i]);
  const bool asked = !std::isnan(length);
  double m = asked ? speed_for_length(chord, G, k, length) : length;
  Fit fit;
  fit.length_met = !(asked && std::isnan(m));
  if (std::isnan(m)) m = speed_as_mean(chord, G, k);
  fit.end_speed = m;

  const double root = std::sqrt(m);
  Quat a0, a2, both, apart;
  for (int i = 0; i < 4; ++i) {
    a0[i] = root * u0[i];
    a2[i] = root * u2[i];
    both[i] = a0[i] + a2[i];
    apart[i] = a0[i] - a2[i];
  }
  Vec c;
  for (int i = 0; i < 3; ++i) c[i] = 120.0 * chord[i] + m * G[i];
  const bool open = !(dot(both, both) > no_turn * no_turn * (dot(a0, a0) + dot(a2, a2)));
  const Quat C = turned(nearest(lift(c), open ? apart : both, chord), std::cos(gamma), std::sin(gamma));
  Quat a1;
  for (int i = 0; i < 4; ++i) a1[i] = (C[i] - 3.0 * a0[i] - 3.0 * a2[i]) / 4.0;
  fit.preimage = {a0, a1, a2};
  fit.length = (dot(a0, a0) + dot(a0, a1) + (dot(a0, a2) + 2.0 * dot(a1, a1)) / 3.0 + dot(a1, a2) +
                dot(a2, a2)) / 5.0;
  return fit;
}

struct Spinor {
  Quat a, d;     // A(t) and A'(t)
  double sigma;  // |A|^2
};

inline Spinor spinor(const std::array<Quat, 3>& A, double t) {
  Spinor s;
  for (int i = 0; i < 4; ++i) {
    const double left = A[0][i] + (A[1][i] - A[0][i]) * t;
    const double right = A[1][i] + (A[2][i] - A[1][i]) * t;
    s.a[i] = left + (right - left) * t;
    s.d[i] = 2.0 * (right - left);
  }
  s.sigma = dot(s.a, s.a);
  return s;
}

// The lowest of `looks` points of a curve, counted from its start; the hodograph is integrated exactly.
inline Vec lowest(const Fit& fit, int looks) {
  const auto& A = fit.preimage;
  const Vec s0 = product(A[0], A[0]), s1 = product(A[0], A[1]), s2 = product(A[0], A[2]),
            s3 = product(A[1], A[1]), s4 = product(A[1], A[2]), s5 = product(A[2], A[2]);
  Vec P[6] = {{0.0, 0.0, 0.0}};
  for (int i = 0; i < 3; ++i) {
    const double step[5] = {s0[i] / 5.0, s1[i] / 5.0, (s2[i] + 2.0 * s3[i]) / 15.0, s4[i] / 5.0, s5[i] / 5.0};
    for (int k = 0; k < 5; ++k) P[k + 1][i] = P[k][i] + step[k];
  }
  Vec best = P[0];
  for (int look = 1; look < looks; ++look) {
    const double t = static_cast<double>(look) / (looks - 1);
    Vec Q[6];
    for (int k = 0; k < 6; ++k) Q[k] = P[k];
    for (int level = 5; level > 0; --level)
      for (int k = 0; k < level; ++k)
        for (int i = 0; i < 3; ++i) Q[k][i] += (Q[k + 1][i] - Q[k][i]) * t;
    if (Q[0][2] < best[2]) best = Q[0];
  }
  return best;
}

// 24-point Gauss rule on [0, 1], by Newton on the Legendre polynomial.
struct Gauss {
  static constexpr int count = 24;
  double node[count], weight[count];
  Gauss() {
    for (int i = 0; i < count; ++i) {
      double x = std::cos(3.14159265358979323846 * (i + 0.75) / (count + 0.5)), slope = 1.0;
      for (int step = 0; step < 20; ++step) {
        double before = 1.0, here = x;
        for (int n = 2; n <= count; ++n) {
          const double next = ((2 * n - 1) * x * here - (n - 1) * before) / n;
          before = here;
          here = next;
        }
        slope = count * (before - x * here) / (1.0 - x * x);
        x -= here / slope;
      }
      node[i] = 0.5 * (1.0 - x);
      weight[i] = 1.0 / ((1.0 - x * x) * slope * slope);
    }
  }
};

// Bending plus twisting energy for unit stiffness.
inline double energy(const std::array<Quat, 3>& A) {
  static const Gauss gauss;
  double sum = 0.0;
  for (int i = 0; i < Gauss::count; ++i) {
    const Spinor s = spinor(A, gauss.node[i]);
    const auto& [u, v, p, q] = s.a;
    const auto& [du, dv, dp, dq] = s.d;
    const double spin = u * dv - du * v - p * dq + dp * q;
    const double k2 = u * dq - du * q - v * dp + dv * p;
    const double k3 = u * dp - du * p + v * dq - dv * q;
    sum += gauss.weight[i] * 4.0 * (spin * spin + k2 * k2 + k3 * k3) / (s.sigma * s.sigma * s.sigma);
  }
  return sum;
}

// For a stated length that may be wrong by a hundredth: see through_rough of contid/models/ph_ends.py.
inline Fit through_rough(const Vec& chord, const Vec& t0, const Vec& t1, double length) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  const Fit fit = through(chord, t0, t1, length, 0.0, 0.0);
  if (std::isnan(length)) return fit;
  Fit free = through(chord, t0, t1, nan, 0.0, 0.0);
  const double most = dear * energy(free.preimage) + small / length;
  if (fit.length_met && energy(fit.preimage) <= most) return fit;
  constexpr double pi = 3.14159265358979323846;
  Fit least = fit;
  double least_energy = std::numeric_limits<double>::infinity();
  for (int branch = 0; branch < 4; ++branch) {
    const Fit other = through(chord, t0, t1, length, branch % 2 ? pi : 0.0, branch / 2 ? pi : 0.0);
    const double cost = energy(other.preimage);
    if (other.length_met && cost < least_energy) {
      least = other;
      least_energy = cost;
    }
  }
  if (least_energy <= most) return least;
  free.length_met = false;
  return free;
}

// Parameter at arc length s: Newton on the quintic, kept inside a bracket that only shrinks.
inline double parameter_at(const std::array<Quat, 3>& A, double length, double s) {
  const std::array<double, 5> sigma = {dot(A[0], A[0]), dot(A[0], A[1]),
                                       (dot(A[0], A[2]) + 2.0 * dot(A[1], A[1])) / 3.0, dot(A[1], A[2]),
                                       dot(A[2], A[2])};
  if (!(s > 0.0)) return 0.0;
  if (s >= length) return 1.0;
  double low = 0.0, high = 1.0, t = s / length;
  for (int iteration = 0; iteration < 60; ++iteration) {
    std::array<double, 6> b;
    b[0] = 0.0;
    for (int i = 0; i < 5; ++i) b[i + 1] = b[i] + sigma[i] / 5.0;
    for (int level = 5; level > 0; --level)
      for (int i = 0; i < level; ++i) b[i] += (b[i + 1] - b[i]) * t;
    const double excess = b[0] - s;
    if (excess == 0.0) return t;
    (excess < 0.0 ? low : high) = t;
    const double speed = spinor(A, t).sigma;
    double next = speed > 0.0 ? t - excess / speed : -1.0;
    if (!(next >= low && next <= high)) next = 0.5 * (low + high);
    if (std::fabs(next - t) <= 1e-15) return next;
    t = next;
  }
  return t;
}

// Bending (u, v) of each section between parameters joints[0..sections], in the rotation-minimising frame
// that starts with U = x of the base.
inline void section_bending(const std::array<Quat, 3>& A, const double* joints, int sections, double* bending) {
  static const double r15 = std::sqrt(15.0);
  static const double node[3] = {0.5 - r15 / 10.0, 0.5, 0.5 + r15 / 10.0};
  static const double weight[3] = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};
  static const double within[3][3] = {
      {5.0 / 36.0, 2.0 / 9.0 - r15 / 15.0, 5.0 / 36.0 - r15 / 30.0},
      {5.0 / 36.0 + r15 / 24.0, 2.0 / 9.0, 5.0 / 36.0 - r15 / 24.0},
      {5.0 / 36.0 + r15 / 30.0, 2.0 / 9.0 + r15 / 15.0, 5.0 / 36.0}};
  const Quat& a0 = A[0];
  const double u0 = a0[0], v0 = a0[1], p0 = a0[2], q0 = a0[3];
  double psi = std::atan2(2.0 * (u0 * p0 + v0 * q0), 2.0 * (v0 * p0 - u0 * q0));
  for (int section = 0; section < sections; ++section) {
    const double width = (joints[section + 1] - joints[section]) / panels;
    double sum_u = 0.0, sum_v = 0.0;
    for (int panel = 0; panel < panels; ++panel) {
      double spin[3], k2[3], k3[3];
      for (int i = 0; i < 3; ++i) {
        const Spinor s = spinor(A, joints[section] + width * (panel + node[i]));
        const auto& [u, v, p, q] = s.a;
        const auto& [du, dv, dp, dq] = s.d;
        const double per = 2.0 / s.sigma;
        spin[i] = per * (u * dv - du * v - p * dq + dp * q);
        k2[i] = per * (u * dq - du * q - v * dp + dv * p);
        k3[i] = -per * (u * dp - du * p + v * dq - dv * q);
      }
      for (int i = 0; i < 3; ++i) {
        const double turn =
            psi - width * (within[i][0] * spin[0] + within[i][1] * spin[1] + within[i][2] * spin[2]);
        const double cosine = std::cos(turn), sine = std::sin(turn);
        sum_u += weight[i] * (cosine * k2[i] + sine * k3[i]);
        sum_v += weight[i] * (cosine * k3[i] - sine * k2[i]);
      }
      psi -= width * (weight[0] * spin[0] + weight[1] * spin[1] + weight[2] * spin[2]);
    }
    bending[2 * section] = width * sum_u;
    bending[2 * section + 1] = width * sum_v;
  }
}

// An arm of sections with tubes around them, standing on its base along +z.
struct Arm {
  int sections = 0, tubes = 0;
  double offset_cos[max_sections][max_tubes];  // d cos(alpha)
  double offset_sin[max_sections][max_tubes];
  double split[max_sections];
};

struct Inverse {
  double lengths[max_sections * max_tubes];
  double totals[max_tubes];
  double backbone[max_sections];
  double bending[2 * max_sections];
  bool length_met;
};

inline Inverse inverse(const Arm& arm, const Vec& tip, const Vec& direction, double length,
                       const double* split) {
  Inverse out;
  const double size = std::sqrt(dot(direction, direction));
  const Vec t1 = {direction[0] / size, direction[1] / size, direction[2] / size};
  const Fit fit = through_rough(tip, {0.0, 0.0, 1.0}, t1, length);
  out.length_met = fit.length_met;
  double joints[max_sections + 1] = {0.0}, travelled = 0.0;
  for (int section = 0; section < arm.sections; ++section) {
    out.backbone[section] = fit.length * split[section];
    travelled += out.backbone[section];
    joints[section + 1] =
        section + 1 < arm.sections ? parameter_at(fit.preimage, fit.length, travelled) : 1.0;
  }
  section_bending(fit.preimage, joints, arm.sections, out.bending);
  for (int tube = 0; tube < arm.tubes; ++tube) out.totals[tube] = 0.0;
  for (int section = 0; section < arm.sections; ++section) {
    const double u = out.bending[2 * section], v = out.bending[2 * section + 1];
    for (int tube = 0; tube < arm.tubes; ++tube) {
      const double l =
          out.backbone[section] - (u * arm.offset_cos[section][tube] + v * arm.offset_sin[section][tube]);
      out.lengths[section * arm.tubes + tube] = l;
      out.totals[tube] += l;
    }
  }
  return out;
}

}  // namespace contid::ph

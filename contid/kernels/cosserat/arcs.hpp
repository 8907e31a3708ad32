// The sweep of a rod that carries nothing: its strains are constant along each section, which is an arc in a plane.
//
// The same numbers as `sections` of rod.hpp but for rounding, derivatives included: there the columns are integrated
// by Runge and Kutta's rule over the elements of a section, which for columns that do not depend on each other is
// Simpson's. With the curvature u across e = e3, q = u x e, and A(s) = sin(ks)/k, B(s) = (1 - cos ks)/k^2, k = |u|,
//
//     R w = w - (w.q) (A e + B q)  across e,      R e = A q + (cos ks) e,      R u = u,
//
// so that a column is a sum of five vectors times numbers that all three pressures share. p is the position at s over
// the stretch 1 + epsilon: (B q + integral of cos ks e) at the end.
#pragma once

#include "rod.hpp"

namespace contid {

// Numbers of one section in the frame of its base: at its end, and as sums over its elements.
struct Arc {
  double a, b, cosine;         // A, B, cos ks at the end
  double shift_q, shift_e;     // position of the end along q and e, per stretch
  double sum_a, sum_b, sum_c;  // of A, B and cos ks by Simpson's rule
  double alpha, beta, gamma;   // of the shift by the turn before, per stretch
};

// `Sums` false leaves out what only derivatives need.
template <bool Sums> inline Arc arc(Vec u, double length, int elements) {
  const double k2 = u.x * u.x + u.y * u.y, h = length / elements, half = 0.5 * h, t2 = half * half * k2;
  double versine, shift;
  if (t2 < 1.0) {
    versine = evaluate(kVersine, t2), shift = evaluate(kShift, t2);
  } else {
    const double t = std::sqrt(t2);
    versine = (1.0 - std::cos(t)) / t2, shift = (1.0 - std::sin(t) / t) / t2;
  }
  const double a1 = half * (1.0 - t2 * shift), b1 = half * half * versine, c1 = 1.0 - k2 * b1;
  const double third = half * half * half * shift;  // integral of B over half an element
  const double sixth = h / 6.0, square = h * sixth;
  Arc sum{};
  double a = 0.0, b = 0.0, c = 1.0, integral_b = 0.0;
  for (int element = 0; element < elements; ++element) {
    const double am = a * c1 + c * a1, bm = b + c * b1 + a * a1, cm = 1.0 - k2 * bm;
    integral_b += b * half + c * third + a * b1;
    const double ae = am * c1 + cm * a1, be = bm + cm * b1 + am * a1, ce = 1.0 - k2 * be;
    integral_b += bm * half + cm * third + am * b1;
    if constexpr (Sums) {
      const double da = sixth * (a + 4.0 * am + ae), db = sixth * (b + 4.0 * bm + be), dc = sixth * (c + 4.0 * cm + ce);
      const double done = element * h;
      sum.alpha += done * da + square * (2.0 * am + ae);
      sum.beta += done * dc + square * (2.0 * cm + ce);
      sum.gamma += sum.sum_a * da - sum.sum_b * dc + square * ((a + am) * am + am * ae - (b + bm) * cm - bm * ce);
      sum.sum_a += da, sum.sum_b += db, sum.sum_c += dc;
    }
    a = ae, b = be, c = ce;
  }
  sum.a = a, sum.b = b, sum.cosine = c;
  sum.shift_q = b, sum.shift_e = length - k2 * integral_b;
  return sum;
}

// Without derivatives.
struct NoDerivatives {
  static constexpr bool kWanted = false;
};

// Derivatives of a sweep: the first `base` columns are of the base moment, which is 0 here and stays it: they are 0.
struct ArcDerivatives {
  static constexpr bool kWanted = true;
  Sweep& out;
  int base, columns;

  static void put(double (&to)[3][kMostColumns], int j, Vec a) { to[0][j] = a.x, to[1][j] = a.y, to[2][j] = a.z; }
  static Vec at(const double (&from)[3][kMostColumns], int j) { return {from[0][j], from[1][j], from[2][j]}; }
  // The pressures of sections below move what lies beyond them.
  void carry(Vec reach, int end) const {
    Columns& by = out.tip.by;
    for (int j = base; j < end; ++j) {
      const Vec moved = cross(at(by.turn, j), reach);
      by.shift[0][j] += moved.x, by.shift[1][j] += moved.y, by.shift[2][j] += moved.z;
    }
  }
};

// Section i and its link, from where the sections below end; see `over_sections` of sweep.cpp.
template <class Derivatives>
inline void arc_section(const Section& section, const double* pressures, int i, int elements, Ends& tip,
                        Derivatives& derivatives) {
  const Inflated s = inflate(section, pressures);
  const double cx = s.curvature_x, cy = s.curvature_y, stretch = 1.0 + s.strain;
  const Arc at = arc<Derivatives::kWanted>({cx, cy, 0.0}, section.length, elements);
  const Mat R = tip.R;
  // R times a vector of the plane across e, and e.
  const auto rotated = [&](double x, double y, double z) { return R * Vec{x, y, z}; };
  if constexpr (Derivatives::kWanted) {
    const int own = derivatives.base + 3 * i;
    derivatives.carry(stretch * rotated(at.sum_a * cy, -at.sum_a * cx, at.sum_c), own);  // by Simpson's rule
    const double soft = s.strain_per_bar + s.softening * s.strain;
    for (int j = 0; j < 3; ++j) {
      const double wx = s.per_bar_x[j], wy = s.per_bar_y[j], sigma = wx * cy - wy * cx;
      const double x = wx + s.softening * cx, y = wy + s.softening * cy, along = x * cx + y * cy;
      const Vec turn = rotated(section.length * x - sigma * at.sum_b * cy, section.length * y + sigma * at.sum_b * cx,
                               -sigma * at.sum_a);
      const double by_u = -sigma * at.gamma * stretch;
      const Vec shift = rotated(stretch * at.beta * y + by_u * cx + soft * at.sum_a * cy,
                                -stretch * at.beta * x + by_u * cy - soft * at.sum_a * cx,
                                -stretch * at.alpha * along + soft * at.sum_c);
      derivatives.put(derivatives.out.tip.by.turn, own + j, turn);
      derivatives.put(derivatives.out.tip.by.shift, own + j, shift);
    }
  }
  tip.p = tip.p + stretch * rotated(at.shift_q * cy, -at.shift_q * cx, at.shift_e);
  // 1 + A hat(u) + B hat(u)^2
  const Mat turned{{{1.0 - at.b * cy * cy, at.b * cx * cy, at.a * cy},
                    {at.b * cx * cy, 1.0 - at.b * cx * cx, -at.a * cx},
                    {-at.a * cy, at.a * cx, at.cosine}}};
  tip.R = R * turned;
  if (i == 0) {
    tip.mid = tip.p;
    if constexpr (Derivatives::kWanted)
      for (int a = 0; a < 3; ++a)
        for (int j = 0; j < derivatives.columns; ++j)
          derivatives.out.mid_shift[a][j] = derivatives.out.tip.by.shift[a][j];
  }
  if (section.link > 0.0) {
    const Vec reach = section.link * column(tip.R, 2);
    tip.p = tip.p + reach;
    if constexpr (Derivatives::kWanted) derivatives.carry(reach, derivatives.base + 3 * i + 3);
  }
}

}  // namespace contid

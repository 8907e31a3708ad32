// Obstacles of a chain of sections: a potential that redundant axes lower, and a check of the whole body.
//
// Points p of the backbone at a distance d(p) from an obstacle, of a body of radius r that keeps a margin m, add
//
//     F z f((r + m + z - d) / z),   f(x) = x^3 / (1 - x) for 0 < x <= 0.9, a parabola with its curvature beyond
//
// to the distance from home (home.hpp): nothing farther than the zone z outside the margin, little where the zone
// begins, and so stiff near the margin that home cannot hold against it. f has a continuous second derivative, so
// answers move continuously with the target.
#pragma once

#include <algorithm>

#include "cholesky.hpp"
#include "sections.hpp"

namespace contid::section_build {

class Avoid : public Surroundings {
 public:
  Avoid() = default;
  explicit Avoid(const Surroundings& around) : Surroundings(around) {}

  // The potential. `slope` (may be null) gets its gradient; the lower triangle of `metric` (may be null) is increased
  // by the part of its second derivative that is never negative.
  double potential(const Sections& s, const double* lengths, double* slope, double* metric) const {
    const int n = s.size();
    if (slope) std::fill(slope, slope + n, 0.0);
    double sum = 0.0;
    Chain chain;
    std::memcpy(chain.rotation, kIdentity, sizeof kIdentity);
    for (int i = 0; i < s.count; ++i) {
      Piece piece(s, lengths, i, chain);
      const double within = radius + margin + zone;
      if (any_near(s, piece, chain, i, within)) {
        const double begin = i == 0 && piece.uvl[2] > 0.0 ? std::min(from / piece.uvl[2], 1.0) : 0.0;
        for (int k = 1; k <= kAlong; ++k) {
          const double part = double(k) / kAlong;
          sum += point(s, piece, chain, i, begin + (1.0 - begin) * part, begin * (1.0 - part), 0.0, slope, metric);
        }
        const int rigid = rigid_points(s.rigid[i]);
        for (int k = 1; k <= rigid; ++k)
          sum += point(s, piece, chain, i, 1.0, 0.0, s.rigid[i] * k / rigid, slope, metric);
      }
      chain.append(s, piece, i);
    }
    return sum;
  }

  // True when the whole body certainly keeps the margin and kSpare.
  bool clear(const Sections& s, const double* lengths) const {
    const double enough = radius + margin + kSpare;
    Chain chain;
    std::memcpy(chain.rotation, kIdentity, sizeof kIdentity);
    for (int i = 0; i < s.count; ++i) {
      Piece piece(s, lengths, i, chain);
      if (any_near(s, piece, chain, i, enough)) {
        const double L = piece.uvl[2], begin = i == 0 ? std::min(from, L) : 0.0;
        for (const Obstacle& obstacle : obstacles) {
          const auto at = [&](double along) {  // arc length from the start of the section
            double p[3], r[9], x[3];
            piece.local(L > 0.0 ? std::min(along / L, 1.0) : 1.0, std::max(along - L, 0.0), p, r);
            chain.place(p, x);
            return obstacle.distance(x);
          };
          const double end = L + behind(s, i);
          if (!far(at, begin, end, at(begin), at(end), enough)) return false;
        }
      }
      chain.append(s, piece, i);
    }
    return true;
  }

 private:
  static constexpr int kAlong = 12;         // points of a section
  static constexpr int kRigid = 8;          // at most, of a rigid piece
  static constexpr double kSpare = 2e-4;    // a check by samples of the body loses less [m]
  static constexpr double kFinest = 4e-4;   // [m]
  static constexpr double kStiffest = 0.9;  // from there the potential is a parabola
  static constexpr double kIdentity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};

  struct Chain;

  // One section: its arc and where that ends, in the frame where it starts.
  struct Piece {
    double uvl[3], p[3], r[9];
    Coefficients c;
    Piece(const Sections& s, const double* lengths, int i, const Chain&) {
      s.arc(lengths, i, uvl);
      c = coefficients(uvl[0] * uvl[0] + uvl[1] * uvl[1]);
      arc_pose(uvl, c, p, r);
    }
    // The point at a share of the arc, or past its end.
    void local(double share, double past, double* point, double* turned) const {
      const double part[3] = {share * uvl[0], share * uvl[1], share * uvl[2]};
      arc_pose(part, coefficients(part[0] * part[0] + part[1] * part[1]), point, turned);
      for (int k = 0; k < 3; ++k) point[k] += past * turned[3 * k + 2];
    }
  };

  // d p / d(u, v, L) in the frame where a section starts.
  static void by_arc(const double* uvl, const Coefficients& c, double* jp) {
    const double u = uvl[0], v = uvl[1], L = uvl[2], uv = L * u * v * c.B1;
    const double rows[9] = {
        L * (c.B + u * u * c.B1), uv, u * c.B, uv, L * (c.B + v * v * c.B1), v * c.B, L * u * c.A1, L * v * c.A1, c.A};
    std::memcpy(jp, rows, sizeof rows);
  }

  // Where the next section starts, and how the sections before move it.
  struct Chain {
    double position[3] = {0, 0, 0}, rotation[9];
    double ends[kMaxSections][3], linear[kMaxSections][3][kColumns], spin[kMaxSections][3][kColumns];

    void place(const double* p, double* out) const {
      turn(rotation, p, out);
      for (int k = 0; k < 3; ++k) out[k] += position[k];
    }

    // Columns of a 3 x 3 matrix by (u, v, L), turned into the base frame, as columns by the lengths.
    void columns(const Sections& s, int i, const double* by_uvl, double (*out)[kColumns]) const {
      double world[9];
      product(rotation, by_uvl, world);
      const double* w = s.to_arc[i];
      for (int a = 0; a < 3; ++a)
        for (int j = 0; j < kColumns; ++j)
          out[a][j] = world[3 * a] * w[j] + world[3 * a + 1] * w[kColumns + j] + world[3 * a + 2] * w[2 * kColumns + j];
    }

    void append(const Sections& s, const Piece& piece, int i) {
      const double u = piece.uvl[0], v = piece.uvl[1];
      const Coefficients& c = piece.c;
      const double jw[9] = {-c.C * u * v, c.C * u * u - 1.0, 0.0, 1.0 - c.C * v * v, c.C * u * v, 0.0,
                            -c.B * v,     c.B * u,           0.0};
      double jp[9], next[9];
      by_arc(piece.uvl, c, jp);
      columns(s, i, jp, linear[i]);
      columns(s, i, jw, spin[i]);
      place(piece.p, ends[i]);
      product(rotation, piece.r, next);
      std::memcpy(rotation, next, sizeof next);
      for (int k = 0; k < 3; ++k) position[k] = ends[i][k] + s.rigid[i] * rotation[3 * k + 2];
    }
  };

  // Length of the rigid piece after a section; none where the tip lies behind its end (a negative one).
  static double behind(const Sections& s, int i) { return std::max(s.rigid[i], 0.0); }

  // True where an obstacle may be nearer to a section than `within`.
  bool any_near(const Sections& s, const Piece& piece, const Chain& chain, int i, double within) const {
    double p[3], r[9], middle[3];
    piece.local(0.5, 0.0, p, r);
    chain.place(p, middle);
    const double reach = 0.5 * piece.uvl[2] + behind(s, i) + within;
    for (const Obstacle& obstacle : obstacles)
      if (obstacle.distance(middle) < reach) return true;
    return false;
  }

  int rigid_points(double rigid) const {
    if (!(rigid > 0.0)) return 0;
    return std::clamp(static_cast<int>(std::ceil(rigid / radius)), 1, kRigid);
  }

  // The potential of one point; `fixed`: share of its place on the arc that does not grow with the length.
  double point(const Sections& s, const Piece& piece, const Chain& chain, int i, double share, double fixed,
               double past, double* slope, double* metric) const {
    double p[3], r[9], x[3];
    piece.local(share, past, p, r);
    chain.place(p, x);
    double sum = 0.0, J[3][kMaxLengths];
    bool differentiated = false;
    for (const Obstacle& obstacle : obstacles) {
      const double near = (radius + margin + zone - obstacle.distance(x)) / zone;
      if (near <= 0.0) continue;
      double first, second;
      sum += force * zone * rise(near, first, second);
      if (!slope) continue;
      if (!differentiated) jacobian(s, piece, chain, i, share, fixed, past, x, r, J);
      differentiated = true;
      double out[3] = {}, row[kMaxLengths];
      obstacle.outwards(x, out);
      const int used = kColumns * (i + 1);
      for (int j = 0; j < used; ++j) row[j] = out[0] * J[0][j] + out[1] * J[1][j] + out[2] * J[2][j];
      for (int j = 0; j < used; ++j) slope[j] -= force * first * row[j];
      if (!metric) continue;
      for (int j = 0; j < used; ++j)
        for (int k = 0; k <= j; ++k) metric[j * kMaxLengths + k] += force / zone * second * row[j] * row[k];
    }
    return sum;
  }

  // x^3 / (1 - x) and its derivatives; a parabola from kStiffest on.
  static double rise(double x, double& first, double& second) {
    const double at = std::min(x, kStiffest), left = 1.0 - at;
    first = (3.0 - 2.0 * at) * at * at / (left * left);
    second = (6.0 - 6.0 * at + 2.0 * at * at) * at / (left * left * left);
    const double more = x - at, value = at * at * at / left + more * (first + 0.5 * more * second);
    first += more * second;
    return value;
  }

  // d x / d lengths of a point of section i, in the base frame.
  static void jacobian(const Sections& s, const Piece& piece, const Chain& chain, int i, double share, double fixed,
                       double past, const double* x, const double* r, double (*J)[kMaxLengths]) {
    for (int m = 0; m < i; ++m) {
      double arm[3];
      for (int k = 0; k < 3; ++k) arm[k] = x[k] - chain.ends[m][k];
      for (int j = 0; j < kColumns; ++j)
        for (int k = 0; k < 3; ++k) {
          const int a = (k + 1) % 3, b = (k + 2) % 3;
          J[k][kColumns * m + j] = chain.linear[m][k][j] + chain.spin[m][a][j] * arm[b] - chain.spin[m][b][j] * arm[a];
        }
    }
    const double part[3] = {share * piece.uvl[0], share * piece.uvl[1], share * piece.uvl[2]};
    const Coefficients c = coefficients(part[0] * part[0] + part[1] * part[1]);
    double jp[9];
    by_arc(part, c, jp);
    for (int k = 0; k < 9; ++k) jp[k] *= share;
    for (int k = 0; k < 3; ++k) jp[3 * k + 2] -= fixed * r[3 * k + 2];
    if (past > 0.0) {  // the rigid piece turns with the end: d(tangent) = spin x tangent
      const double u = part[0], v = part[1];
      const double jw[9] = {-c.C * u * v, c.C * u * u - 1.0, 0.0, 1.0 - c.C * v * v, c.C * u * v, 0.0,
                            -c.B * v,     c.B * u,           0.0};
      for (int k = 0; k < 3; ++k) {
        const int a = (k + 1) % 3, b = (k + 2) % 3;
        for (int j = 0; j < 2; ++j)
          jp[3 * k + j] += past * (jw[3 * a + j] * r[3 * b + 2] - jw[3 * b + j] * r[3 * a + 2]);
      }
    }
    double own[3][kColumns];
    chain.columns(s, i, jp, own);
    for (int k = 0; k < 3; ++k)
      for (int j = 0; j < kColumns; ++j) J[k][kColumns * i + j] = own[k][j];
  }

  // True when a distance that changes no faster than its place stays `enough` between two places.
  template <class Distance>
  static bool far(const Distance& distance, double begin, double end, double at_begin, double at_end, double enough) {
    if (at_begin < enough || at_end < enough) return false;
    if (0.5 * (at_begin + at_end - (end - begin)) >= enough) return true;
    if (end - begin < kFinest) return false;
    const double middle = 0.5 * (begin + end), at_middle = distance(middle);
    return far(distance, begin, middle, at_begin, at_middle, enough) &&
           far(distance, middle, end, at_middle, at_end, enough);
  }
};

}  // namespace contid::section_build

// A pneumatic rod and its sweeps from base to tip: what sweep.cpp computes and every search asks for.
//
// contid/kinematics/cosserat/compliance.py states the equations, element.py those of an element, stability.hpp the
// stability. Units: mm, N, N*mm, bar. C++17, no allocation, no exceptions.
#pragma once

#include <algorithm>

#include "section.hpp"

namespace contid {

constexpr int kMostSections = 8;
constexpr int kMost = 3 * kMostSections;  // pressures
constexpr int kMostColumns = 28;          // three of the base moment and those of the pressures, in whole registers

// Sections from base to tip with their own weight and the loads at their ends; the share of a sweep scales these.
struct Rod {
  int count = 0;
  Section sections[kMostSections];
  double reach;
  Vec tip_moment = {0, 0, 0};
  bool joints = false, moments = false;  // true with a force or a moment at the end of a section; with any moment
  bool arcs = false;                     // true where it carries nothing, and its sections are arcs

  int pressures() const { return 3 * count; }
  const Section* begin() const { return sections; }
  const Section* end() const { return sections + count; }
};

// Frame and position of a cross-section; mu is the moment there about the base.
struct Pose {
  Mat R;
  Vec p, mu;
};

// Derivatives by column: turn of the frame, shift of the position, change of mu.
struct Columns {
  double turn[3][kMostColumns], shift[3][kMostColumns], dmu[3][kMostColumns];
};

struct State : Pose {
  Columns by;
};

// Where a sweep ends: frame and position of the tip, end of the first section, moment residual.
struct Ends {
  Mat R;
  Vec p, mid, moment;
};

// Result of a sweep with derivatives: tip, frame, end of the first section, moment residual, and the derivatives of all
// four by the base moment (base = 3; 0 leaves it out) and the pressures.
struct Sweep {
  const int base;
  State tip;
  Vec mid, moment;
  double mid_shift[3][kMostColumns], residual[3][kMostColumns];

  Sweep(int base = 3) : base(base) {}
  Ends ends() const { return {tip.R, tip.p, mid, moment}; }
};

// A sweep with the columns of the base moment: where it ends, how both points follow the moment balance, and how many
// directions are unstable (valid in equilibrium; 0 means stable).
struct Judged {
  Ends ends;
  Mat moment_by_balance, tip_by_balance, mid_by_balance;
  int modes;
  bool regular;  // false at a critical load, where the matrices are undefined
};

// In what follows `share` scales the own weight, for continuation.

void sweep(const Rod& rod, const double* pressures, Vec base_moment, Vec tip_force, double share, int elements,
           Sweep& out);

// The same without derivatives.
Ends ends_of(const Rod& rod, const double* pressures, Vec base_moment, Vec tip_force, double share, int elements);

void judge(const Rod& rod, const double* pressures, Vec base_moment, Vec tip_force, double share, int elements,
           Judged& out);

// Derivative of the tip by the force on it, pressures constant, of a rod in equilibrium, without loads on its joints
// (`Rod::joints` false); false at a critical load.
bool tip_compliance(const Rod& rod, const double* pressures, Vec base_moment, Vec tip_force, int elements, Mat& out);

constexpr std::size_t kFrame = 12;  // position, then the rotation row by row

// Frames of a rod in equilibrium at ascending reference arc lengths from 0 to the reach, kFrame numbers for each. A
// station inside an element is reached by one step from its start.
void frames_at(const Rod& rod, const double* pressures, Vec base_moment, Vec tip_force, int elements,
               const double* stations, std::size_t count, double* out);

// Where a rod ends that carries nothing: the same bits as `ends_of`, in a tenth of its time.
Ends unloaded_ends(const Rod& rod, const double* pressures, int elements);

inline Vec own_weight(const Section& s) { return s.length * s.weight + s.link * s.link_weight; }

// Force at the base: everything the rod carries.
inline Vec base_force(const Rod& rod, Vec tip_force, double share) {
  Vec N = tip_force;
  for (const Section& s : rod) N = N + share * own_weight(s);
  if (rod.joints)
    for (const Section& s : rod) N = N + share * s.end_force;
  return N;
}

// True without own weight and forces at the ends of sections.
inline bool massless(const Rod& rod, double share) {
  if (rod.joints && share != 0.0) return false;
  double most = 0.0;
  for (const Section& s : rod) {
    const Vec a = share * s.weight, b = share * s.link_weight;
    most = std::max(most, dot(a, a) + dot(b, b));
  }
  return most == 0.0;
}

inline Mat first_columns(const double (&rows)[3][kMostColumns]) {
  Mat a;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) a.m[i][j] = rows[i][j];
  return a;
}

}  // namespace contid

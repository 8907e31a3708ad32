// How many elements per section a rod needs for a stated error of tip and mid-point: the scheme of element.hpp is of
// fourth order, so that a sweep with two thirds of the elements gives an estimate of the error.
#pragma once

#include "branch.hpp"
#include "solver.hpp"

namespace contid {

// Estimated error of the tip and of the end of the first section from a sweep with fewer elements (n and m differ by
// (n/m)^4 - 1 times the error of n).
inline double discretisation_error(const Rod& rod, const double* pressures, Vec moment, const Judged& at, Vec tip_force,
                                   int n) {
  const int m = n > 1 ? std::max(1, 2 * n / 3) : 2;
  const Ends other = ends_of(rod, pressures, moment, tip_force, 1.0, m);
  const Vec unbalanced = other.moment - at.ends.moment;
  const Vec tip = other.p - at.ends.p - at.tip_by_balance * unbalanced;
  const Vec mid = other.mid - at.ends.mid - at.mid_by_balance * unbalanced;
  const double ratio = static_cast<double>(n) / m;
  return std::fmax(norm(tip), norm(mid)) / std::fabs(ratio * ratio * ratio * ratio - 1.0);
}

// True where the elements of a pose are enough, or the most.
inline bool is_fine(const Rod& rod, const double* pressures, Vec moment, const Judged& at, Vec tip_force, int elements,
                    double error) {
  return elements >= kMaxElements || discretisation_error(rod, pressures, moment, at, tip_force, elements) <= error;
}

// `equilibrium` with as many elements as the load demands, and with more before it ends short of the full load. Each
// number of elements follows the path anew: where it passes near a fork, they decide on which side it goes on.
inline double fine_equilibrium(const Rod& rod, const double* pressures, Vec tip_force, const Settings& settings,
                               Vec& moment, Judged& out, int& elements) {
  for (elements = settings.elements;; elements *= 2) {
    const double done = equilibrium(rod, pressures, tip_force, elements, moment, out);
    if (elements >= kMaxElements || !loaded(rod, tip_force)) return done;
    if (done == 1.0 && is_fine(rod, pressures, moment, out, tip_force, elements, settings.error)) return done;
  }
}

}  // namespace contid

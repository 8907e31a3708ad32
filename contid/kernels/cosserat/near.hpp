// An equilibrium near a known one, with the derivatives of the tip: a bounded piece of work for every tick.
#pragma once

#include "branch.hpp"
#include "solver.hpp"

namespace contid {

// At most kCorrections sweeps from a guess of the base moment, and two for the derivatives. False where Newton's method
// does not contract from there, or the equilibrium is unstable.
inline bool near_equilibrium(const Rod& rod, const double* pressures, Vec tip_force, Vec guess, int elements,
                             Near& out) {
  Judged at;
  out.moment = guess;
  const double tolerance = statics_tolerance(load_scale(rod, tip_force));
  if (!settle(rod, pressures, out.moment, tip_force, 1.0, elements, tolerance, at)) return false;
  out.tip = at.ends.p;
  const int n = rod.pressures();
  Sweep tangents;
  sweep(rod, pressures, out.moment, tip_force, 1.0, elements, tangents);
  for (int j = 0; j < n; ++j) {
    const Vec unbalanced{tangents.residual[0][3 + j], tangents.residual[1][3 + j], tangents.residual[2][3 + j]};
    const Vec held = at.tip_by_balance * unbalanced;
    const double part[3] = {held.x, held.y, held.z};
    for (int i = 0; i < 3; ++i) out.by_pressure[n * i + j] = tangents.tip.by.shift[i][3 + j] - part[i];
  }
  return tip_compliance(rod, pressures, out.moment, tip_force, elements, out.by_force);
}

}  // namespace contid

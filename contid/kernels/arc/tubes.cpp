// The solver of tubes and racks for any number of sections, or with CONTID_SECTIONS for one number.
#include "section_solver.hpp"

namespace contid::section_build {

std::unique_ptr<ChainSolver> make_arc_solver(const ArcSetup& setup) {
  const int count = setup.count;
  Feasible f;
  Sections& s = f.sections;
  s.set_count(count);
  std::copy(setup.radius, setup.radius + count, s.radius);
  std::copy(setup.rigid, setup.rigid + count, s.rigid);
  std::copy(setup.to_arc[0], setup.to_arc[0] + 9 * count, s.to_arc[0]);
  std::copy(setup.to_lengths[0], setup.to_lengths[0] + 9 * count, s.to_lengths[0]);
  for (int i = 0; i < f.size(); ++i) f.low[i] = setup.lower[i / 3], f.high[i] = setup.upper[i / 3];
  std::copy(setup.home, setup.home + f.size(), f.home);
  f.rack = setup.rack;
  f.curvature_max = setup.curvature_max;
  f.weigh_home();
  return std::make_unique<SectionSolver>(f, setup.tuning);
}

}  // namespace contid::section_build

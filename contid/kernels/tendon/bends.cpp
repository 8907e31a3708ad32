// The solver of the bends of tendon robots for any number of sections, or with CONTID_SECTIONS for one number.
#include "../arc/section_solver.hpp"

namespace contid::section_build {

std::unique_ptr<ChainSolver> make_tendon_solver(const TendonSetup& setup) {
  const int count = setup.count;
  const auto held = std::make_unique<Feasible>();
  Feasible& f = *held;
  Sections& s = f.sections;
  s.set_count(count);
  const int n = s.size();
  std::copy(setup.backbone, setup.backbone + count, s.backbone);
  std::copy(setup.rigid, setup.rigid + count, s.rigid);
  std::copy(setup.offset, setup.offset + 2, s.offset);
  std::copy(setup.bend_max, setup.bend_max + count, f.bend_max);
  f.planes_count = static_cast<int>(setup.offsets.size());
  std::copy(setup.offsets.begin(), setup.offsets.end(), f.offsets);
  for (int k = 0; k < f.planes_count; ++k) std::copy_n(setup.normals.begin() + k * n, n, f.normals[k]);
  for (double& entry : f.metric) entry = 0.0;
  for (int i = 0; i < n; ++i) {
    const double most = s.backbone[i / 2] * f.bend_max[i / 2];
    f.low[i] = -most, f.high[i] = most;
    f.metric[i * kMaxLengths + i] = 0.5;
  }
  for (int i = 0; i < count; ++i) {
    const double per_length[6] = {1.0 / s.backbone[i], 0.0, 0.0, 1.0 / s.backbone[i], 0.0, 0.0};
    std::memcpy(s.to_arc[i], per_length, sizeof per_length);
  }
  return std::make_unique<SectionSolver>(f, setup.tuning);
}

}  // namespace contid::section_build

// Frames of a rod in equilibrium at given reference arc lengths: twin of contid/kinematics/cosserat/shape.py.
#pragma once

#include "branch.hpp"

namespace contid {

constexpr std::size_t kFrame = 12;  // position, then the rotation row by row

// `stations` ascend from 0 to the reach; `out` takes kFrame numbers for each. A station inside an element is reached
// by one step from its start.
template <int K>
void frames_at(const Rod<K>& rod, const double* pressures, Vec base_moment, Vec tip_force, int elements,
               const double* stations, std::size_t count, double* out) {
  State<1> state{identity(), {0, 0, 0}, base_moment, {}};
  Vec N = base_force<K>(rod, tip_force, 1.0);
  std::size_t next = 0;
  const auto write = [&](const State<1>& at) {
    double* row = out + kFrame * next++;
    put(row, at.p);
    std::copy(&at.R.m[0][0], &at.R.m[0][0] + 9, row + 3);
  };
  double begin = 0.0;
  for (int i = 0; i < K; ++i) {
    const Section& section = rod.sections[i];
    const Inflated inflated = inflate(section, pressures + 3 * i);
    const double h = section.length / elements;
    for (int k = 0; k < elements; ++k) {
      const double end = begin + (k + 1) * h;
      while (next < count && stations[next] < end) {
        State<1> at = state;
        step<0, -1>(inflated, at, N, section.weight, stations[next] - (begin + k * h));
        write(at);
      }
      step<0, -1>(inflated, state, N, section.weight, h);
      N = N - h * section.weight;
    }
    begin += section.length;
    if (rod.joints) {
      joint<0>(state, section.end_force, section.end_moment);
      N = N - section.end_force;
    }
    if (section.link > 0.0) {
      while (next < count && stations[next] < begin + section.link) {
        State<1> at = state;
        at.p = at.p + (stations[next] - begin) * column(at.R, 2);
        write(at);
      }
      link<0>(state, section.link, section.link_weight);
      N = N - section.link * section.link_weight;
      begin += section.link;
    }
  }
  while (next < count) write(state);
}

}  // namespace contid

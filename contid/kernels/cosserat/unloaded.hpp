// Where a rod ends that carries nothing: the same bits as `sweep` of rod.hpp, in a tenth of its time.
//
// Without moments every stage of an element has the strains of the pressures, so every half element of a section is the
// same screw, which is computed once.
#pragma once

#include "../column.hpp"
#include "rod.hpp"

namespace contid {

template <int K> Ends unloaded_ends(const Rod<K>& rod, const double* pressures, int elements) {
  Column R[3] = {{1.0, 0.0, 0.0, 0.0}, {0.0, 1.0, 0.0, 0.0}, {0.0, 0.0, 1.0, 0.0}}, p{}, mid{};
  for (int i = 0; i < K; ++i) {
    const Section& section = rod.sections[i];
    const Inflated s = inflate(section, pressures + 3 * i);
    const Vec u{s.curvature_x, s.curvature_y, 0.0}, v{0.0, 0.0, 1.0 + s.strain};
    const double k = section.length / elements / 12.0;
    Mat turn;
    Vec shift;
    screw(k * (3.0 * u + 2.0 * u + 2.0 * u - u), k * (3.0 * v + 2.0 * v + 2.0 * v - v), turn, shift);
    for (int half = 0; half < 2 * elements; ++half) {
      p += R[0] * shift.x + R[1] * shift.y + R[2] * shift.z;
      Column next[3];
      for (int j = 0; j < 3; ++j) next[j] = R[0] * turn.m[0][j] + R[1] * turn.m[1][j] + R[2] * turn.m[2][j];
      for (int j = 0; j < 3; ++j) R[j] = next[j];
    }
    if (i == 0) mid = p;
    if (section.link > 0.0) p += section.link * R[2];
  }
  Ends ends{{}, {p[0], p[1], p[2]}, {mid[0], mid[1], mid[2]}, {0.0, 0.0, 0.0}};
  for (int a = 0; a < 3; ++a)
    for (int j = 0; j < 3; ++j) ends.R.m[a][j] = R[j][a];
  return ends;
}

}  // namespace contid

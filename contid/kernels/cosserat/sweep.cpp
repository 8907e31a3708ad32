// Sweeps of a rod from base to tip: nearly all the time of an answer. Compiled a second time for wider registers.
#include <cassert>

#include "../column.hpp"
#include "arcs.hpp"
#include "element.hpp"
#include "stability.hpp"

namespace contid {

namespace {

// Sections from base to tip in one state. `element(inflated, i, N, f, h)` moves it over one element of section i,
// `end(i)` is called where its last one ends; both work on the same state.
template <class Element, class End, class Joint, class Link>
[[gnu::always_inline]] inline void over_sections(const Rod& rod, const double* pressures, double share, int elements,
                                                 Vec N, const Element& element, const End& end, const Joint& joint,
                                                 const Link& link) {
  for (int i = 0; i < rod.count; ++i) {
    const Section& section = rod.sections[i];
    const Inflated inflated = inflate(section, pressures + 3 * i);
    const Vec f = share * section.weight;
    const double h = section.length / elements;
    for (int k = 0; k < elements; ++k) {
      element(inflated, i, N, f, h);
      N = N - h * f;
    }
    end(i);
    if (rod.joints) {
      joint(i, share * section.end_force, share * section.end_moment);
      N = N - share * section.end_force;
    }
    if (section.link > 0.0) {
      const Vec lf = share * section.link_weight;
      link(i, section.link, lf);
      N = N - section.link * lf;
    }
  }
}

Pose base_pose(Vec base_moment) { return {identity(), {0, 0, 0}, base_moment}; }

Ends ends_of_arcs(const Rod& rod, const double* pressures, Vec base_moment, int elements) {
  Ends ends{identity(), {0, 0, 0}, {}, base_moment};
  NoDerivatives none;
  for (int i = 0; i < rod.count; ++i) arc_section(rod.sections[i], pressures + 3 * i, i, elements, ends, none);
  return ends;
}

void sweep_arcs(const Rod& rod, const double* pressures, Vec base_moment, int elements, Sweep& out) {
  Ends ends{identity(), {0, 0, 0}, {}, base_moment};
  ArcDerivatives derivatives{out, out.base, out.base + rod.pressures()};
  for (int i = 0; i < rod.count; ++i) arc_section(rod.sections[i], pressures + 3 * i, i, elements, ends, derivatives);
  out.tip.R = ends.R, out.tip.p = ends.p, out.mid = ends.mid, out.moment = ends.moment;
  for (int a = 0; a < 3; ++a)
    for (int j = 0; j < derivatives.columns; ++j) out.residual[a][j] = out.tip.by.dmu[a][j];
}

}  // namespace

void sweep(const Rod& rod, const double* pressures, Vec base_moment, Vec tip_force, double share, int elements,
           Sweep& out) {
  State& state = out.tip;
  const int columns = padded(out.base + rod.pressures());
  static_cast<Pose&>(state) = base_pose(base_moment);
  clear(state.by, columns);
  for (int i = 0; i < out.base; ++i) state.by.dmu[i][i] = 1.0;
  if (rod.arcs) return sweep_arcs(rod, pressures, base_moment, elements, out);
  // The columns of sections farther up have not moved yet.
  const auto moving = [&](int i) { return padded(out.base + 3 * i + 3); };
  over_sections(
      rod, pressures, share, elements, base_force(rod, tip_force, share),
      [&](const Inflated& inflated, int i, Vec N, Vec f, double h) {
        step(inflated, state, N, f, h, OwnColumns(inflated, out.base + 3 * i), moving(i));
      },
      [&](int i) {
        if (i > 0) return;
        out.mid = state.p;
        for (int a = 0; a < 3; ++a)
          for (int j = 0; j < columns; j += kLanes) lanes(out.mid_shift[a][j]) = lanes(state.by.shift[a][j]);
      },
      [&](int i, Vec force, Vec moment) { joint(state, force, moment, moving(i)); },
      [&](int i, double length, Vec f) { link(state, length, f, moving(i)); });
  out.moment = state.mu - cross(state.p, tip_force) - share * rod.tip_moment;
  for (int a = 0; a < 3; ++a)
    for (int j = 0; j < columns; j += kLanes) lanes(out.residual[a][j]) = lanes(state.by.dmu[a][j]);
  add_cross(tip_force, state.by.shift, columns, out.residual);
}

Ends ends_of(const Rod& rod, const double* pressures, Vec base_moment, Vec tip_force, double share, int elements) {
  if (rod.arcs) return ends_of_arcs(rod, pressures, base_moment, elements);
  Pose pose = base_pose(base_moment);
  Vec mid{};
  over_sections(
      rod, pressures, share, elements, base_force(rod, tip_force, share),
      [&](const Inflated& inflated, int, Vec N, Vec f, double h) { step(inflated, pose, N, f, h); },
      [&](int i) { mid = i == 0 ? pose.p : mid; }, [&](int, Vec force, Vec moment) { joint(pose, force, moment); },
      [&](int, double length, Vec f) { link(pose, length, f); });
  return {pose.R, pose.p, mid, pose.mu - cross(pose.p, tip_force) - share * rod.tip_moment};
}

void judge(const Rod& rod, const double* pressures, Vec base_moment, Vec tip_force, double share, int elements,
           Judged& out) {
  if (rod.arcs) {  // nothing that could buckle it
    out = {ends_of_arcs(rod, pressures, base_moment, elements), identity(), {}, {}, 0, true};
    return;
  }
  constexpr int kColumns = padded(3);  // those of the base moment suffice
  State state;
  static_cast<Pose&>(state) = base_pose(base_moment);
  clear(state.by, kColumns);
  for (int i = 0; i < 3; ++i) state.by.dmu[i][i] = 1.0;
  Mat before = identity(), mid_by_moment{};
  bool first = true, regular = true;
  out.modes = 0;
  over_sections(
      rod, pressures, share, elements, base_force(rod, tip_force, share),
      [&](const Inflated& inflated, int, Vec N, Vec f, double h) {
        step(inflated, state, N, f, h, NoOwnColumns{}, kColumns);
        const Mat turn = first_columns(state.by.turn);
        if (!first) out.modes += negative(turn * before);
        first = false;
        regular = inverse(turn, before) && regular;
      },
      [&](int i) {
        if (i == 0) out.ends.mid = state.p, mid_by_moment = first_columns(state.by.shift);
      },
      [&](int, Vec force, Vec moment) { joint(state, force, moment, kColumns); },
      [&](int, double length, Vec f) { link(state, length, f, kColumns); });
  out.ends.R = state.R;
  out.ends.p = state.p;
  out.ends.moment = state.mu - cross(state.p, tip_force) - share * rod.tip_moment;
  add_cross(tip_force, state.by.shift, kColumns, state.by.dmu);
  out.regular = inverse(first_columns(state.by.dmu), out.moment_by_balance) && regular;
  if (!out.regular) {
    out.modes = rod.pressures();
    return;
  }
  out.tip_by_balance = first_columns(state.by.shift) * out.moment_by_balance;
  out.mid_by_balance = mid_by_moment * out.moment_by_balance;
  Mat stiffness = first_columns(state.by.dmu) * before;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < i; ++j) stiffness.m[i][j] = stiffness.m[j][i] = 0.5 * (stiffness.m[i][j] + stiffness.m[j][i]);
  out.modes += negative(stiffness);
}

bool tip_compliance(const Rod& rod, const double* pressures, Vec base_moment, Vec tip_force, int elements, Mat& out) {
  assert(!rod.joints);
  constexpr int kColumns = padded(6);
  State state;
  static_cast<Pose&>(state) = base_pose(base_moment);
  clear(state.by, kColumns);
  for (int i = 0; i < 3; ++i) state.by.dmu[i][i] = 1.0;
  over_sections(
      rod, pressures, 1.0, elements, base_force(rod, tip_force, 1.0),
      [&](const Inflated& inflated, int, Vec N, Vec f, double h) {
        step(inflated, state, N, f, h, ForceColumns{inflated}, kColumns);
      },
      [](int) {}, [](int, Vec, Vec) {}, [&](int, double length, Vec f) { link(state, length, f, kColumns); });
  add_cross(tip_force, state.by.shift, kColumns, state.by.dmu);
  Mat by_balance, unbalanced, free;
  const Mat lever = hat(state.p);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      unbalanced.m[i][j] = state.by.dmu[i][3 + j] - lever.m[i][j];
      free.m[i][j] = state.by.shift[i][3 + j];
    }
  if (!inverse(first_columns(state.by.dmu), by_balance)) return false;
  const Mat held = first_columns(state.by.shift) * (by_balance * unbalanced);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out.m[i][j] = free.m[i][j] - held.m[i][j];
  return true;
}

void frames_at(const Rod& rod, const double* pressures, Vec base_moment, Vec tip_force, int elements,
               const double* stations, std::size_t count, double* out) {
  Pose pose = base_pose(base_moment);
  Vec N = base_force(rod, tip_force, 1.0);
  std::size_t next = 0;
  const auto write = [&](const Pose& at) {
    double* row = out + kFrame * next++;
    row[0] = at.p.x, row[1] = at.p.y, row[2] = at.p.z;
    std::copy(&at.R.m[0][0], &at.R.m[0][0] + 9, row + 3);
  };
  double begin = 0.0;
  for (int i = 0; i < rod.count; ++i) {
    const Section& section = rod.sections[i];
    const Inflated inflated = inflate(section, pressures + 3 * i);
    const double h = section.length / elements;
    for (int k = 0; k < elements; ++k) {
      const double end = begin + (k + 1) * h;
      while (next < count && stations[next] < end) {
        Pose at = pose;
        step(inflated, at, N, section.weight, stations[next] - (begin + k * h));
        write(at);
      }
      step(inflated, pose, N, section.weight, h);
      N = N - h * section.weight;
    }
    begin += section.length;
    if (rod.joints) {
      joint(pose, section.end_force, section.end_moment);
      N = N - section.end_force;
    }
    if (section.link > 0.0) {
      while (next < count && stations[next] < begin + section.link) {
        Pose at = pose;
        at.p = at.p + (stations[next] - begin) * column(at.R, 2);
        write(at);
      }
      link(pose, section.link, section.link_weight);
      N = N - section.link * section.link_weight;
      begin += section.link;
    }
  }
  while (next < count) write(pose);
}

// Without moments every stage of an element has the strains of the pressures, so every half element of a section is the
// same screw, which is computed once.
Ends unloaded_ends(const Rod& rod, const double* pressures, int elements) {
  Column R[3] = {{1.0, 0.0, 0.0, 0.0}, {0.0, 1.0, 0.0, 0.0}, {0.0, 0.0, 1.0, 0.0}}, p{}, mid{};
  for (int i = 0; i < rod.count; ++i) {
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

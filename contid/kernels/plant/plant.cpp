// contid.kernels._plant: the simulated pneumatic arm, by the literal equations of the paper (Shi et al., eqs. 1-11
// with the errata of docs/robots/stiffflop.md).
//
// Another formulation than contid.kernels._cosserat on purpose: wall force and wall moment as states, classical RK4
// over a rotation that it does not keep orthogonal, shooting with finite differences.
// Units: mm, N, N*mm, bar.
#include <vector>

#include "../cosserat/spatial.hpp"
#include "../python.hpp"
#include "../record.hpp"

namespace nb = nanobind;
using namespace contid;

namespace {

constexpr int kNewton = 20;           // steps at most
constexpr int kUnknowns = 4;          // base moment and push of the wall
constexpr int kNumbers = 18;          // of a section
constexpr double kStepMoment = 1e-6;  // [N*mm], of the differences by the base moment
constexpr double kStepForce = 1e-7;   // [N], of the differences by the push of the wall
constexpr double kBalance = 1e-9;     // [N*mm], moments left over at the tip in equilibrium
constexpr double kGap = 1e-9;         // [mm], distance of a held tip from the wall

struct Section {
  double length, link, area, inertia, torsion, push;  // push: force of a pair [N/bar]
  double turn[3][2];                                  // moment of every pair [N*mm/bar], x and y
  double modulus[5], up_to;                           // [Pa] by the average pressure, which is clamped to up_to [bar]
};

// Position, rotation, force and moment of the wall at an arc length.
struct State {
  Vec p;
  Mat R;
  Vec n, m;
};

// A section under its pressures: axial force [N] and moment [N*mm] of the chambers, stiffness to shear and extension
// [N], to bending and torsion [N*mm^2].
struct Wall {
  double push;
  Vec turn, K_se, K_bt;
};

Wall wall_of(const Section& s, const double* pressures) {
  const double sum = pressures[0] + pressures[1] + pressures[2];
  const double x = std::fmin(std::fmax(sum / 3.0, 0.0), s.up_to);
  const double* b = s.modulus;
  const double E = 1e-6 * ((((b[0] * x + b[1]) * x + b[2]) * x + b[3]) * x + b[4]), G = E / 3.0;
  Wall w;
  w.push = s.push * sum;
  w.turn = {0, 0, 0};
  for (int k = 0; k < 3; ++k) w.turn.x += s.turn[k][0] * pressures[k], w.turn.y += s.turn[k][1] * pressures[k];
  w.K_se = {G * s.area, G * s.area, E * s.area};
  w.K_bt = {E * s.inertia, E * s.inertia, G * s.torsion};
  return w;
}

// Derivative of the state by arc length.
State rates(const Wall& w, const State& at) {
  const Vec a = transposed_times(at.R, at.n), b = transposed_times(at.R, at.m);
  const Vec v{a.x / w.K_se.x, a.y / w.K_se.y, 1.0 + a.z / w.K_se.z};
  const Vec u{b.x / w.K_bt.x, b.y / w.K_bt.y, b.z / w.K_bt.z};
  State d;
  d.p = at.R * v;
  d.R = at.R * hat(u);
  d.n = w.push * column(d.R, 2);
  const Vec side = w.push * Vec{v.y, -v.x, 0.0};
  d.m = at.R * (side + cross(u, w.turn)) - cross(d.p, at.n);
  return d;
}

// The state a length h further with the derivative d.
State ahead(const State& at, double h, const State& d) {
  State s = at;
  s.p = s.p + h * d.p;
  s.n = s.n + h * d.n;
  s.m = s.m + h * d.m;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) s.R.m[i][j] += h * d.R.m[i][j];
  return s;
}

struct Arm {
  std::vector<Section> sections;
  int steps;

  Arm(nb::handle rows, int steps) : steps(steps) {
    for (nb::handle row : rows) {
      double x[kNumbers];
      read(row, x, kNumbers, "a section: 18 numbers");
      sections.push_back({x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11], x[12], x[13], x[14],
                          x[15], x[16], x[17]});
    }
  }

  // Tip, and the moment left over there, for a total base moment and a dead force on the tip.
  State shoot(const double* pressures, Vec force, Vec moment) const {
    State at{{0, 0, 0}, identity(), force, moment};
    for (std::size_t i = 0; i < sections.size(); ++i) {
      const Section& s = sections[i];
      const Wall w = wall_of(s, pressures + 3 * i);
      at.n = at.n + w.push * column(at.R, 2);
      at.m = at.m + at.R * w.turn;
      const double h = s.length / steps;
      for (int k = 0; k < steps; ++k) {
        const State a = rates(w, at), b = rates(w, ahead(at, 0.5 * h, a)), c = rates(w, ahead(at, 0.5 * h, b)),
                    d = rates(w, ahead(at, h, c));
        at = ahead(ahead(ahead(ahead(at, h / 6.0, a), h / 3.0, b), h / 3.0, c), h / 6.0, d);
      }
      at.n = at.n - w.push * column(at.R, 2);
      at.m = at.m - at.R * w.turn;
      const Vec e = column(at.R, 2);
      at.m = at.m - s.link * cross(e, at.n);
      at.p = at.p + s.link * e;
    }
    return at;
  }

  // Newton's method from `guess` (base moment, push of the wall); the wall is left out with `held` false.
  // Returns tip, unknowns, and whether it converged.
  nb::object solve(nb::handle pressures_, nb::handle force_, nb::handle guess_, bool held, nb::handle normal_,
                   double offset) const {
    std::vector<double> pressures(3 * sections.size());
    read(pressures_, pressures.data(), static_cast<Py_ssize_t>(pressures.size()), "pressures: three per section");
    double x[kUnknowns], f[3], nn[3];
    read(guess_, x, kUnknowns, "guess: four numbers");
    read(force_, f, 3, "force: three numbers");
    read(normal_, nn, 3, "normal: three numbers");
    const Vec load{f[0], f[1], f[2]}, normal{nn[0], nn[1], nn[2]};
    const int n = held ? 4 : 3;
    if (!held) x[3] = 0.0;
    Vec tip{0, 0, 0};
    const auto residual = [&](const double* at, double* out) {
      const State end = shoot(pressures.data(), load + at[3] * normal, {at[0], at[1], at[2]});
      out[0] = end.m.x, out[1] = end.m.y, out[2] = end.m.z;
      out[3] = dot(normal, end.p) - offset;
      return end.p;
    };
    for (int round = 0; round < kNewton; ++round) {
      double r[4], A[4][5];
      tip = residual(x, r);
      const double moments = std::fabs(r[0]) + std::fabs(r[1]) + std::fabs(r[2]);
      if (moments < kBalance && (!held || std::fabs(r[3]) < kGap)) return answer(tip, x, true);
      for (int j = 0; j < n; ++j) {
        double y[4] = {x[0], x[1], x[2], x[3]}, moved[4];
        const double step = j < 3 ? kStepMoment : kStepForce;
        y[j] += step;
        residual(y, moved);
        for (int i = 0; i < n; ++i) A[i][j] = (moved[i] - r[i]) / step;
      }
      for (int i = 0; i < n; ++i) A[i][4] = r[i];
      for (int i = 0; i < n; ++i) {  // elimination with the greatest pivot
        int best = i;
        for (int k = i + 1; k < n; ++k)
          if (std::fabs(A[k][i]) > std::fabs(A[best][i])) best = k;
        std::swap(A[i], A[best]);
        if (!(std::fabs(A[i][i]) > 1e-300)) return answer(tip, x, false);
        for (int k = i + 1; k < n; ++k) {
          const double part = A[k][i] / A[i][i];
          for (int j = i; j < n; ++j) A[k][j] -= part * A[i][j];
          A[k][4] -= part * A[i][4];
        }
      }
      for (int i = n - 1; i >= 0; --i) {
        double sum = A[i][4];
        for (int j = i + 1; j < n; ++j) sum -= A[i][j] * A[j][4];
        A[i][4] = sum / A[i][i];
      }
      for (int i = 0; i < n; ++i) x[i] -= A[i][4];
    }
    return answer(tip, x, false);
  }

  static nb::object answer(Vec tip, const double* x, bool met) {
    const double p[3] = {tip.x, tip.y, tip.z};
    static const Record record("contid.kernels.PlantEquilibrium", {"tip_mm", "unknowns", "found"});
    return record(tuple_of(p, 3), tuple_of(x, kUnknowns), met);
  }
};

}  // namespace

namespace contid {
void bind_profile(nb::module_& module);
}

NB_MODULE(KERNEL_MODULE, module) {
  module.doc() = "The simulated pneumatic arm by the literal equations and RK4, and the motions of simulated devices.";
  contid::bind_profile(module);
  nb::class_<Arm>(module, "Arm")
      .def(nb::init<nb::handle, int>(), nb::arg("sections"), nb::arg("steps"))
      .def("solve", &Arm::solve, nb::arg("pressures"), nb::arg("force"), nb::arg("guess"), nb::arg("held"),
           nb::arg("normal"), nb::arg("offset"));
}

// contid.kernels._tendon_rod: the rod of extras/tendons/contid_tendons/rod.py. One object is for one thread: it holds
// the memory of its solves. A solve takes tens of microseconds and holds the GIL.
#include <nanobind/nanobind.h>

#include "../arrays.hpp"
#include "../python.hpp"
#include "rod.hpp"

namespace nb = nanobind;
using namespace contid;

namespace {

struct Solver {
  TendonRodSolver rod;

  // Reads the fields of RodElements (extras/tendons/contid_tendons/rod.py) by name.
  static RodSetup setup_of(nb::handle of) {
    RodSetup s;
    const auto array = [&](const char* name) { return nb::cast<Given>(of.attr(name)); };
    const Given h = array("lengths"), rest = array("rest");
    s.elements = static_cast<int>(h.size());
    s.tendons = static_cast<int>(rest.size());
    if (s.elements < 1 || s.tendons < 1 || s.tendons > kMaxTendons)
      throw nb::value_error("1 to 64 tendons, 1 element at least");
    s.stretches = nb::cast<bool>(of.attr("stretches"));
    s.base = nb::cast<double>(of.attr("base_m"));
    const size_t n = s.elements, m = s.tendons;
    s.h = numbers(h, n, "lengths: one number per element");
    s.rest = numbers(rest, m, "rest: one number per tendon");
    s.rigid = numbers(array("rigid"), n, "rigid: one number per element");
    s.stiffness = numbers(array("stiffness"), 4 * n, "stiffness: four numbers per element");
    s.arms = numbers(array("arms"), 2 * n * m, "arms: two numbers per element and tendon");
    s.tendon = numbers(array("tendon"), m, "tendon: one number per tendon");
    const std::vector<double> weight = numbers(array("weight"), 3 * n, "weight: three numbers per element");
    for (size_t e = 0; e < n; ++e) s.weight.push_back({weight[3 * e], weight[3 * e + 1], weight[3 * e + 2]});
    const std::vector<double> offset = numbers(array("offset"), 3, "offset: three numbers");
    s.offset = {offset[0], offset[1], offset[2]};
    return s;
  }

  explicit Solver(nb::handle setup) : rod(setup_of(setup)) {}

  // Fills the arrays of a TendonEquilibrium (extras/tendons/contid_tendons/rod.py), `jacobian` and `compliance` with
  // `derivatives` only, for pulls [m] and a force on the tip [N], from the strain `start` on. Returns 1 for a stable
  // equilibrium, 0 for another one, below 0 when none was found or it has no derivatives.
  int solve(Given pulls, nb::handle force, Given start, nb::handle into, bool derivatives) {
    const RodSetup& s = rod.setup();
    const auto array = [&](const char* name) { return nb::cast<Rows>(into.attr(name), false); };
    Rows strain = array("strain"), points = array("points_m"), rotation = array("rotation"), tip = array("tip_m"),
         tensions = array("tensions_n"), jacobian = array("jacobian"), compliance = array("compliance");
    const size_t n = s.elements, m = s.tendons;
    const bool fits = pulls.size() == m && start.size() == 4 * n && strain.size() == 4 * n &&
                      points.size() == 3 * (n + 1) && rotation.size() == 9 && tensions.size() == m && tip.size() == 3 &&
                      jacobian.size() == 3 * m && compliance.size() == 9;
    if (!fits) throw nb::value_error("the arrays do not have the size of the rod");
    double f[3];
    read(force, f, 3, "force: three numbers");
    const TendonRodSolver::State* at = rod.solve(pulls.data(), {f[0], f[1], f[2]}, start.data());
    if (at == nullptr) return -1;
    std::copy(at->x.begin(), at->x.end(), strain.data());
    for (size_t i = 0; i <= n; ++i) {
      const Vec p = at->points[i];
      points.data()[3 * i] = p.x, points.data()[3 * i + 1] = p.y, points.data()[3 * i + 2] = p.z;
    }
    for (int i = 0; i < 9; ++i) rotation.data()[i] = at->frames[n].m[i / 3][i % 3];
    std::copy(at->tension.begin(), at->tension.end(), tensions.data());
    tip.data()[0] = at->tip.x, tip.data()[1] = at->tip.y, tip.data()[2] = at->tip.z;
    const int stable = rod.stable(*at) ? 1 : 0;
    if (!derivatives) return stable;
    return rod.derivatives(*at, jacobian.data(), compliance.data()) ? stable : -1;
  }
};

}  // namespace

void contid::bind(nb::module_& module) {
  module.doc() = "Backbones of tendon robots as rods: equilibria and their derivatives.";
  nb::class_<Solver>(module, "Rod")
      .def(nb::init<nb::handle>(), nb::arg("setup"))
      .def("solve", &Solver::solve, nb::arg("pulls"), nb::arg("force"), nb::arg("start"), nb::arg("into"),
           nb::arg("derivatives"));
}

#include "../modules.hpp"

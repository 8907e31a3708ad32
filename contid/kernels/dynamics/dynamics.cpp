// contid.kernels._dynamics: motion of rods. One object is for one thread: it holds the memory of its steps.
#include <nanobind/nanobind.h>
#include <nanobind/stl/vector.h>

#include <cmath>

#include "../arrays.hpp"
#include "../python.hpp"
#include "rod_motion.hpp"

namespace nb = nanobind;
using namespace contid;

namespace {

constexpr int kPose = 12;         // position and rotation, rows one after the other
constexpr int kInterrupt = 1000;  // steps between looks at Ctrl-C

void fill(std::vector<double>& into, const Given& given, const char* what) { into = numbers(given, into.size(), what); }

std::vector<double> finite(const Given& given, size_t count, const char* what) {
  std::vector<double> values = numbers(given, count, what);
  for (double value : values)
    if (!std::isfinite(value)) throw nb::value_error("finite numbers are expected");
  return values;
}

struct Rod {
  RodMotion motion;

  static std::vector<Inertia> inertias(nb::handle of, const char* name, size_t count) {
    const std::vector<double> pairs = numbers(nb::cast<Given>(of.attr(name)), 2 * count, "inertia: two numbers each");
    std::vector<Inertia> out(count);
    for (size_t i = 0; i < count; ++i) out[i] = {pairs[2 * i], pairs[2 * i + 1]};
    return out;
  }

  static MotionSetup setup_of(nb::handle of) {
    MotionSetup s;
    const auto array = [&](const char* name) { return nb::cast<Given>(of.attr(name)); };
    const Given lengths = array("lengths"), rest = array("rest");
    const size_t n = lengths.size(), m = rest.size();
    // Eight sections of 32 elements and of eight tendons.
    if (n < 1 || n > 256 || m > 64) throw nb::value_error("1 to 256 elements, at most 64 tendons");
    s.elements = static_cast<int>(n), s.tendons = static_cast<int>(m);
    s.strains = nb::cast<int>(of.attr("strains"));
    if (s.strains != 3 && s.strains != 4 && s.strains != kMaxStrains) throw nb::value_error("strains: 3, 4 or 6");
    s.base = nb::cast<double>(of.attr("base_m"));
    s.lengths = numbers(lengths, n, "lengths");
    s.rigid = numbers(array("rigid"), n, "rigid: one number per element");
    s.middles = inertias(of, "middles", n), s.ends = inertias(of, "ends", n);
    s.rest = numbers(rest, m, "rest");
    s.tendon = numbers(array("tendon"), m, "tendon: one number per tendon");
    s.arms = numbers(array("arms"), 2 * n * m, "arms: two numbers per element and tendon");
    return s;
  }

  explicit Rod(nb::handle setup) : motion(setup_of(setup)) {}

  void load(nb::handle gravity, Given nodes, Given strains, Given pulls, double within_s) {
    double g[3];
    read(gravity, g, 3, "gravity: three numbers");
    const size_t n = motion.setup().elements;
    const std::vector<double> wrenches = finite(nodes, 6 * n, "nodes: six numbers per element");
    std::vector<double> own = finite(strains, motion.loads.strains.size(), "strains: six numbers per element");
    std::vector<double> pulled = finite(pulls, motion.loads.pulls.size(), "pulls: one number per tendon");
    // Nothing is replaced before all of it is checked.
    motion.loads.strains.swap(own), motion.loads.pulls.swap(pulled);
    motion.loads.gravity = {g[0], g[1], g[2]}, motion.loads.reached_in_s = within_s;
    for (size_t e = 0; e < n; ++e) {
      const double* w = &wrenches[6 * e];
      motion.loads.nodes[e] = {{w[0], w[1], w[2]}, {w[3], w[4], w[5]}};
    }
  }

  // Damping is the stiffness times `damping_s`.
  void stiffen(Given stiffness, double damping_s) {
    fill(motion.stiffness, stiffness, "stiffness: six numbers per element");
    motion.damping_s = damping_s;
  }

  void put(Given strains) {
    motion.put(finite(strains, motion.strain.size(), "strains: six numbers per element").data());
  }

  void pose(int node, double* out) const {
    const Vec p = motion.placed().points[node];
    out[0] = p.x, out[1] = p.y, out[2] = p.z;
    for (int i = 0; i < 9; ++i) out[3 + i] = motion.placed().frames[node].m[i / 3][i % 3];
  }

  // Steps of `step` seconds; after each `every` of them a row of `poses` (rows, nodes, 12). Steps made: fewer than
  // asked for where one had no answer.
  int run(double step, int every, nb::handle nodes, Rows poses) {
    const std::vector<int> asked = nb::cast<std::vector<int>>(nodes);
    if (poses.ndim() != 3 || poses.shape(1) != asked.size() || poses.shape(2) != kPose || every < 1 || !(step > 0.0))
      throw nb::value_error("poses: rows x nodes x 12 numbers; steps above 0");
    for (int node : asked)
      if (node < 0 || node > motion.setup().elements) throw nb::value_error("nodes: 0 to the number of elements");
    int made = 0;
    for (size_t row = 0; row < poses.shape(0); ++row) {
      for (int k = 0; k < every; ++k, ++made) {
        if (!motion.step(step)) return made;
        if (made % kInterrupt == 0 && PyErr_CheckSignals() != 0) throw nb::python_error();
      }
      for (size_t i = 0; i < asked.size(); ++i) pose(asked[i], poses.data() + kPose * (row * asked.size() + i));
    }
    return made;
  }

  void poses(Rows out) const {
    if (out.size() != static_cast<size_t>(kPose) * (motion.setup().elements + 1))
      throw nb::value_error("poses: nodes x 12");
    for (int node = 0; node <= motion.setup().elements; ++node) pose(node, out.data() + kPose * node);
  }

  void linearise(Rows mass, Rows stiffness) {
    const size_t n = motion.free();
    if (mass.size() != n * n || stiffness.size() != n * n) throw nb::value_error("matrices: free x free");
    motion.linearise(mass.data(), stiffness.data());
  }

  void state(Rows strain, Rows momentum) const {
    if (strain.size() != motion.strain.size() || momentum.size() != motion.momentum.size())
      throw nb::value_error("arrays of the rod's size");
    std::copy(motion.strain.begin(), motion.strain.end(), strain.data());
    std::copy(motion.momentum.begin(), motion.momentum.end(), momentum.data());
  }

  nb::tuple tensions() const { return tuple_of(motion.tensions.data(), motion.setup().tendons); }
};

}  // namespace

NB_MODULE(KERNEL_MODULE, module) {
  module.doc() = "Rods in motion: elements of constant strain, a variational integrator.";
  nb::class_<Rod>(module, "Rod")
      .def(nb::init<nb::handle>(), nb::arg("setup"))
      .def_prop_ro("free", [](const Rod& r) { return r.motion.free(); })
      .def("load", &Rod::load, nb::arg("gravity"), nb::arg("nodes"), nb::arg("strains"), nb::arg("pulls"),
           nb::arg("within_s"))
      .def("stiffen", &Rod::stiffen, nb::arg("stiffness"), nb::arg("damping_s"))
      .def("put", &Rod::put, nb::arg("strains"))
      .def("settle", [](Rod& r) { return r.motion.settle(); })
      .def("run", &Rod::run, nb::arg("step"), nb::arg("every"), nb::arg("nodes"), nb::arg("poses").noconvert())
      .def("poses", &Rod::poses, nb::arg("out").noconvert())
      .def("state", &Rod::state, nb::arg("strain").noconvert(), nb::arg("momentum").noconvert())
      .def("kinetic", [](Rod& r) { return r.motion.kinetic(); })
      .def("potential", [](Rod& r) { return r.motion.potential(); })
      .def("linearise", &Rod::linearise, nb::arg("mass").noconvert(), nb::arg("stiffness").noconvert())
      .def("tensions", &Rod::tensions);
}

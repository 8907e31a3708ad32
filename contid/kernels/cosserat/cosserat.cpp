// contid.kernels._cosserat: the pneumatic rod for Python, the protocol contid.kinematics.cosserat.engine.RodSolver.
// Single calls take microseconds and hold the GIL: releasing it costs up to two switch intervals of a busy thread.

#include <nanobind/nanobind.h>

#include <stdexcept>

#include "../batch_python.hpp"
#include "../python.hpp"
#include "bends.hpp"
#include "solver.hpp"

namespace nb = nanobind;
using namespace contid;

namespace {

Vec vec(nb::handle sequence) {
  double a[3];
  read(sequence, a, 3, "expected three numbers");
  return {a[0], a[1], a[2]};
}

nb::tuple triple(Vec a) { return nb::make_tuple(a.x, a.y, a.z); }

constexpr const char* kPressures = "expected three pressures per section";
constexpr const char* kStationRows = "stations: an array (n,)";

// What contid.kinematics.cosserat.section.Loads has for a section; zero where it has nothing.
Vec entry(nb::handle table, int section) {
  const nb::object found = table.attr("get")(section);
  return found.is_none() ? Vec{0, 0, 0} : vec(found);
}

using Stations = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Frames = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

Arm arm_of(nb::handle setup) {
  Arm arm{};
  Rod& rod = arm.rod;
  const nb::object described = setup.attr("rod"), weight = setup.attr("weight");
  const nb::object sections = described.attr("sections");
  const nb::object weights = weight.attr("weight"), link_weights = weight.attr("link_weight");
  const std::size_t count = nb::len(sections);
  if (count < 1 || count > kMostSections) throw std::invalid_argument("the kernel is built for one to eight sections");
  rod.count = static_cast<int>(count);
  rod.reach = nb::cast<double>(described.attr("reach"));
  for (int i = 0; i < rod.count; ++i) {
    const nb::object from = sections[i];
    Section& to = rod.sections[i];
    const auto number = [&](const char* name) { return nb::cast<double>(from.attr(name)); };
    to.length = number("length");
    to.link = number("link");
    to.area = number("area");
    to.inertia = number("inertia");
    to.torsion = number("torsion");
    to.shear_ratio = number("shear_ratio");
    to.pair_force = number("pair_force");
    to.modulus_up_to = number("modulus_up_to_bar");
    for (int k = 0; k < 5; ++k) to.modulus[k] = nb::cast<double>(from.attr("modulus_pa")[k]);
    for (int axis = 0; axis < 2; ++axis)
      for (int k = 0; k < 3; ++k) to.pair_moment[axis][k] = nb::cast<double>(from.attr("pair_moment")[axis][k]);
    to.weight = entry(weights, i);
    to.link_weight = entry(link_weights, i);
  }
  const nb::object box = setup.attr("limits");
  arm.limits.count = rod.pressures();
  for (int i = 0; i < rod.pressures(); ++i) {
    arm.limits.lower[i] = nb::cast<double>(box.attr("lower")[i]);
    arm.limits.upper[i] = nb::cast<double>(box.attr("upper")[i]);
    arm.limits.centre[i] = nb::cast<double>(box.attr("centre")[i]);
  }
  arm.settings = {nb::cast<int>(setup.attr("elements")), nb::cast<double>(setup.attr("tolerance")),
                  nb::cast<double>(setup.attr("error")), nb::cast<bool>(setup.attr("thorough"))};
  return arm;
}

struct Engine {
  Arm arm;
  Bends bent;
  double length;
  bool full_rotation;

  explicit Engine(nb::handle setup) : arm(arm_of(setup)), bent(arm) {
    length = nb::cast<double>(setup.attr("direction_length"));
    full_rotation = nb::cast<bool>(setup.attr("full_rotation"));
  }

  int count() const { return arm.rod.pressures(); }
  void pressures_of(nb::handle given, double* p) const { read(given, p, count(), kPressures); }

  nb::tuple inverse(nb::handle tip, nb::handle mid, nb::handle direction, nb::handle force, nb::handle seed) const {
    Task task{};
    task.tip = vec(tip);
    task.length = length;
    if (!mid.is_none()) task.has_mid = true, task.mid = vec(mid);
    if (!direction.is_none()) {
      task.has_direction = true;
      task.direction = vec(direction);
      task.full_rotation = full_rotation;
      if (full_rotation) task.frame = tilt(task.direction);
    }
    double start[kMost];
    pressures_of(seed, start);
    const Answer a = arm.inverse(task, vec(force), start);
    return nb::make_tuple(tuple_of(a.pressures, count()), a.residual, a.met, a.optimal, a.stable, a.iterations,
                          a.elements, a.statics, a.blocked, a.snap);
  }

  nb::tuple forward(nb::handle pressures, nb::handle force) const {
    double p[kMost];
    pressures_of(pressures, p);
    const Equilibrium at = arm.forward(arm.rod, p, vec(force));
    return nb::make_tuple(triple(at.ends.p), tuple_of(&at.ends.R.m[0][0], 9), triple(at.ends.mid), at.done == 1.0,
                          triple(at.moment), at.elements);
  }

  nb::object near(nb::handle pressures, nb::handle force, nb::handle guess) const {
    double p[kMost];
    pressures_of(pressures, p);
    Near found;
    if (!arm.near(p, vec(force), vec(guess), found)) return nb::none();
    return nb::make_tuple(triple(found.tip), triple(found.moment), tuple_of(&found.by_force.m[0][0], 9),
                          tuple_of(found.by_pressure, 3 * count()));
  }

  nb::tuple statics(nb::handle pressures, nb::handle loads, Stations stations, Frames out) const {
    if (out.shape(0) != stations.shape(0) || out.shape(1) != kFrame) throw nb::value_error(kStationRows);
    double p[kMost];
    pressures_of(pressures, p);
    Rod under = arm.rod;
    const Vec force = vec(loads.attr("tip_force"));
    under.tip_moment = vec(loads.attr("tip_moment"));
    under.moments = nb::cast<bool>(loads.attr("has_moments"));
    const nb::object forces = loads.attr("joint_force"), moments = loads.attr("joint_moment");
    const nb::object weights = loads.attr("weight"), link_weights = loads.attr("link_weight");
    under.joints = nb::len(forces) + nb::len(moments) > 0;
    for (int i = 0; i < under.count; ++i) {
      Section& s = under.sections[i];
      s.end_force = entry(forces, i);
      s.end_moment = entry(moments, i);
      s.weight = entry(weights, i);
      s.link_weight = entry(link_weights, i);
    }
    const Equilibrium at = arm.forward(under, p, force);
    frames_at(under, p, at.moment, force, at.elements, stations.data(), stations.shape(0), out.data());
    return nb::make_tuple(at.done, triple(at.moment), at.elements);
  }

  nb::tuple bends(nb::handle pressures, nb::handle force) const {
    double p[kMost], out[kMost];
    pressures_of(pressures, p);
    bent.read(arm, p, vec(force), out);
    return tuple_of(out, count());
  }

  nb::object of_bends(nb::handle asked, nb::handle force, nb::handle seed) const {
    double start[kMost], bend[kMost], p[kMost];
    read(asked, bend, count(), "expected two components and a length per section");
    pressures_of(seed, start);
    if (!bent.solve(arm, bend, vec(force), start, p)) return nb::none();
    return tuple_of(p, count());
  }

  nb::object critical(nb::handle pressures, nb::handle force, double max_factor) const {
    double p[kMost];
    pressures_of(pressures, p);
    const double factor = arm.critical(p, vec(force), max_factor);
    if (factor < 0.0) return nb::none();
    return nb::float_(factor);
  }

  void inverse_many(Matrix tip, nb::handle mid, nb::handle direction, nb::handle force, Matrix seeds, Table out,
                    int threads) const {
    const std::size_t rows = out.shape(0);
    check(tip, rows, 3, "tip: an array (rows, 3)");
    const TaskRows tasks{targets_of(tip, direction, mid, force), length, full_rotation};
    check(seeds, rows, count(), kPressures);
    check(out, rows, solution_bytes(count()));
    const nb::gil_scoped_release released;
    arm.inverse_rows(tasks, rows, seeds.data(), threads, out.data());
  }

  void forward_many(Matrix pressures, nb::handle force, Table out, int threads) const {
    const std::size_t rows = out.shape(0);
    const double* loads = nullptr;
    if (!force.is_none()) {
      const Matrix given = nb::cast<Matrix>(force);
      check(given, rows, 3, "force: an array (rows, 3)");
      loads = given.data();
    }
    check(pressures, rows, count(), kPressures);
    check(out, rows, kPoseBytes);
    const nb::gil_scoped_release released;
    arm.forward_rows(pressures.data(), loads, rows, threads, out.data());
  }
};

}  // namespace

void contid::bind(nb::module_& m) {
  nb::class_<Engine>(m, "Engine")
      .def(nb::init<nb::handle>(), nb::arg("setup"))
      .def("inverse", &Engine::inverse, nb::arg("tip"), nb::arg("mid").none(), nb::arg("direction").none(),
           nb::arg("force"), nb::arg("seed"))
      .def("inverse_many", &Engine::inverse_many, nb::arg("tip"), nb::arg("mid").none(), nb::arg("direction").none(),
           nb::arg("force").none(), nb::arg("seeds"), nb::arg("out").noconvert(), nb::arg("threads"))
      .def("forward_many", &Engine::forward_many, nb::arg("pressures"), nb::arg("force").none(),
           nb::arg("out").noconvert(), nb::arg("threads"))
      .def("forward", &Engine::forward, nb::arg("pressures"), nb::arg("force"))
      .def("near", &Engine::near, nb::arg("pressures"), nb::arg("force"), nb::arg("guess"))
      .def("statics", &Engine::statics, nb::arg("pressures"), nb::arg("loads"), nb::arg("stations"),
           nb::arg("out").noconvert())
      .def("bends", &Engine::bends, nb::arg("pressures"), nb::arg("force"))
      .def("of_bends", &Engine::of_bends, nb::arg("asked"), nb::arg("force"), nb::arg("seed"))
      .def("critical", &Engine::critical, nb::arg("pressures"), nb::arg("force"), nb::arg("max_factor") = 1.0);
}

#include "../modules.hpp"

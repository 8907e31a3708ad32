// contid.kernels._cosserat: the pneumatic rod for Python, the protocol contid.kinematics.cosserat.engine.RodSolver.
// Single calls take microseconds and hold the GIL: releasing it costs up to two switch intervals of a busy thread.

#include <nanobind/nanobind.h>

#include <memory>
#include <stdexcept>

#include "../batch_python.hpp"
#include "../python.hpp"
#include "batch.hpp"
#include "near.hpp"
#include "stations.hpp"

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
constexpr const char* kStations = "stations: an array (n,)";

// What contid.kinematics.cosserat.loads.Loads has for a section; zero where it has nothing.
Vec entry(nb::handle table, int section) {
  const nb::object found = table.attr("get")(section);
  return found.is_none() ? Vec{0, 0, 0} : vec(found);
}

using Stations = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Frames = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// One arm, its number of sections a value of the run.
struct Arm {
  virtual ~Arm() = default;
  virtual nb::tuple inverse(const Task& task, Vec force, nb::handle seed) const = 0;
  virtual nb::tuple forward(nb::handle pressures, Vec force) const = 0;
  virtual nb::object near(nb::handle pressures, Vec force, Vec guess) const = 0;
  virtual nb::object critical(nb::handle pressures, Vec force, double max_factor) const = 0;
  virtual nb::tuple statics(nb::handle pressures, nb::handle loads, Stations stations, Frames out) const = 0;
  virtual void inverse_many(const TaskRows& tasks, Matrix seeds, Table out, int threads) const = 0;
  virtual void forward_many(Matrix pressures, const double* loads, Table out, int threads) const = 0;
};

template <int K> struct ArmOf final : Arm {
  Rod<K> rod;
  Limits<K> limits;
  Settings settings;

  explicit ArmOf(nb::handle setup) {
    const nb::object described = setup.attr("rod"), weight = setup.attr("weight");
    const nb::object sections = described.attr("sections");
    const nb::object weights = weight.attr("weight"), link_weights = weight.attr("link_weight");
    rod.reach = nb::cast<double>(described.attr("reach"));
    for (int i = 0; i < K; ++i) {
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
    for (int i = 0; i < 3 * K; ++i) {
      limits.lower[i] = nb::cast<double>(box.attr("lower")[i]);
      limits.upper[i] = nb::cast<double>(box.attr("upper")[i]);
      limits.centre[i] = nb::cast<double>(box.attr("centre")[i]);
    }
    settings = {nb::cast<int>(setup.attr("elements")), nb::cast<double>(setup.attr("tolerance")),
                nb::cast<double>(setup.attr("error")), nb::cast<bool>(setup.attr("thorough"))};
  }

  nb::tuple inverse(const Task& task, Vec force, nb::handle seed) const override {
    double start[3 * K];
    read(seed, start, 3 * K, kPressures);
    const Found<K> found = search_settled<K>(rod, task, force, limits, start, settings);
    const Outcome<K>& o = found.outcome;
    return nb::make_tuple(tuple_of(o.pressures, 3 * K), o.residual, o.met, o.optimal, found.stable, found.iterations,
                          found.elements, o.statics, o.blocked, found.snap);
  }

  nb::tuple forward(nb::handle pressures, Vec force) const override {
    double p[3 * K];
    read(pressures, p, 3 * K, kPressures);
    Judged at;
    Vec moment;
    int elements;
    const bool stable = fine_equilibrium<K>(rod, p, force, settings, moment, at, elements) == 1.0;
    if (!stable) buckled<K>(rod, p, force, elements, moment, at);
    return nb::make_tuple(triple(at.ends.p), tuple_of(&at.ends.R.m[0][0], 9), triple(at.ends.mid), stable,
                          triple(moment), elements);
  }

  nb::object near(nb::handle pressures, Vec force, Vec guess) const override {
    double p[3 * K];
    read(pressures, p, 3 * K, kPressures);
    Near<K> found;
    if (!contid::near<K>(rod, p, force, guess, settings.elements, found)) return nb::none();
    return nb::make_tuple(triple(found.tip), triple(found.moment), tuple_of(&found.by_force.m[0][0], 9),
                          tuple_of(found.by_pressure, 9 * K));
  }

  nb::tuple statics(nb::handle pressures, nb::handle loads, Stations stations, Frames out) const override {
    if (out.shape(0) != stations.shape(0) || out.shape(1) != kFrame) throw nb::value_error(kStations);
    double p[3 * K];
    read(pressures, p, 3 * K, kPressures);
    Rod<K> under = rod;
    const Vec force = vec(loads.attr("tip_force"));
    under.tip_moment = vec(loads.attr("tip_moment"));
    under.moments = nb::cast<bool>(loads.attr("has_moments"));
    const nb::object forces = loads.attr("joint_force"), moments = loads.attr("joint_moment");
    const nb::object weights = loads.attr("weight"), link_weights = loads.attr("link_weight");
    under.joints = nb::len(forces) + nb::len(moments) > 0;
    for (int i = 0; i < K; ++i) {
      Section& s = under.sections[i];
      s.end_force = entry(forces, i);
      s.end_moment = entry(moments, i);
      s.weight = entry(weights, i);
      s.link_weight = entry(link_weights, i);
    }
    Judged at;
    Vec moment;
    int elements;
    const double done = fine_equilibrium<K>(under, p, force, settings, moment, at, elements);
    if (done < 1.0) buckled<K>(under, p, force, elements, moment, at);
    frames_at<K>(under, p, moment, force, elements, stations.data(), stations.shape(0), out.data());
    return nb::make_tuple(done, triple(moment), elements);
  }

  nb::object critical(nb::handle pressures, Vec force, double max_factor) const override {
    double p[3 * K];
    read(pressures, p, 3 * K, kPressures);
    const double factor = critical_factor<K>(rod, p, force, max_factor, settings.elements);
    if (factor < 0.0) return nb::none();
    return nb::float_(factor);
  }

  void inverse_many(const TaskRows& tasks, Matrix seeds, Table out, int threads) const override {
    check(seeds, out.shape(0), 3 * K, kPressures);
    check(out, out.shape(0), solution_bytes(3 * K));
    const nb::gil_scoped_release released;
    inverse_rows<K>(rod, limits, settings, tasks, out.shape(0), seeds.data(), threads, out.data());
  }

  void forward_many(Matrix pressures, const double* loads, Table out, int threads) const override {
    check(pressures, out.shape(0), 3 * K, kPressures);
    check(out, out.shape(0), kPoseBytes);
    const nb::gil_scoped_release released;
    forward_rows<K>(rod, settings, pressures.data(), loads, out.shape(0), threads, out.data());
  }
};

struct Engine {
  std::unique_ptr<Arm> arm;
  double length;
  bool full_rotation;

  explicit Engine(nb::handle setup) {
    const size_t sections = nb::len(nb::object(setup.attr("rod").attr("sections")));
    length = nb::cast<double>(setup.attr("direction_length"));
    full_rotation = nb::cast<bool>(setup.attr("full_rotation"));
    if (sections == 1)
      arm = std::make_unique<ArmOf<1>>(setup);
    else if (sections == 2)
      arm = std::make_unique<ArmOf<2>>(setup);
    else if (sections == 3)
      arm = std::make_unique<ArmOf<3>>(setup);
    else if (sections == 4)
      arm = std::make_unique<ArmOf<4>>(setup);
    else if (sections == 5)
      arm = std::make_unique<ArmOf<5>>(setup);
    else if (sections == 6)
      arm = std::make_unique<ArmOf<6>>(setup);
    else if (sections == 7)
      arm = std::make_unique<ArmOf<7>>(setup);
    else if (sections == 8)
      arm = std::make_unique<ArmOf<8>>(setup);
    else
      throw std::invalid_argument("the kernel is built for one to eight sections");
  }

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
    return arm->inverse(task, vec(force), seed);
  }

  void inverse_many(Matrix tip, nb::handle mid, nb::handle direction, nb::handle force, Matrix seeds, Table out,
                    int threads) const {
    check(tip, out.shape(0), 3, "tip: an array (rows, 3)");
    arm->inverse_many({targets_of(tip, direction, mid, force), length, full_rotation}, seeds, out, threads);
  }

  void forward_many(Matrix pressures, nb::handle force, Table out, int threads) const {
    const double* loads = nullptr;
    if (!force.is_none()) {
      const Matrix rows = nb::cast<Matrix>(force);
      check(rows, out.shape(0), 3, "force: an array (rows, 3)");
      loads = rows.data();
    }
    arm->forward_many(pressures, loads, out, threads);
  }
};

}  // namespace

NB_MODULE(KERNEL_MODULE, m) {
  nb::class_<Engine>(m, "Engine")
      .def(nb::init<nb::handle>(), nb::arg("setup"))
      .def("inverse", &Engine::inverse, nb::arg("tip"), nb::arg("mid").none(), nb::arg("direction").none(),
           nb::arg("force"), nb::arg("seed"))
      .def("inverse_many", &Engine::inverse_many, nb::arg("tip"), nb::arg("mid").none(), nb::arg("direction").none(),
           nb::arg("force").none(), nb::arg("seeds"), nb::arg("out"), nb::arg("threads"))
      .def("forward_many", &Engine::forward_many, nb::arg("pressures"), nb::arg("force").none(), nb::arg("out"),
           nb::arg("threads"))
      .def(
          "forward",
          [](const Engine& e, nb::handle pressures, nb::handle force) { return e.arm->forward(pressures, vec(force)); },
          nb::arg("pressures"), nb::arg("force"))
      .def(
          "near",
          [](const Engine& e, nb::handle pressures, nb::handle force, nb::handle guess) {
            return e.arm->near(pressures, vec(force), vec(guess));
          },
          nb::arg("pressures"), nb::arg("force"), nb::arg("guess"))
      .def(
          "statics",
          [](const Engine& e, nb::handle pressures, nb::handle loads, Stations stations, Frames out) {
            return e.arm->statics(pressures, loads, stations, out);
          },
          nb::arg("pressures"), nb::arg("loads"), nb::arg("stations"), nb::arg("out"))
      .def(
          "critical",
          [](const Engine& e, nb::handle pressures, nb::handle force, double max_factor) {
            return e.arm->critical(pressures, vec(force), max_factor);
          },
          nb::arg("pressures"), nb::arg("force"), nb::arg("max_factor") = 1.0);
}

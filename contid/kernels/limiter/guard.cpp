// The stop checks of a live stream for Python, and the limits that lengths share. Short calls, under the GIL.
#include "guard.hpp"

#include <nanobind/nanobind.h>

#include <limits>

#include "../python.hpp"
#include "axis_records.hpp"
#include "catch_up.hpp"
#include "shared_bend.hpp"
#include "shared_lengths.hpp"
#include "taut_pulls.hpp"

namespace nb = nanobind;
using contid::AxisNumbers, contid::Moving, contid::read, contid::SharedBend, contid::SharedLengths, contid::TautPulls;

namespace {

constexpr char kPerAxis[] = "guard: one number per axis";

std::vector<double> numbers(nb::handle sequence) {
  std::vector<double> found(PyObject_Length(sequence.ptr()) < 0 ? 0 : PyObject_Length(sequence.ptr()));
  read(sequence, found.data(), static_cast<Py_ssize_t>(found.size()), kPerAxis);
  return found;
}

void make_lengths(SharedLengths* self, nb::handle radius_m, nb::handle to_arc, double rack_m, double curvature_max) {
  const auto radii = numbers(radius_m), rows = numbers(to_arc);
  const int sections = static_cast<int>(radii.size());
  if (rows.size() != 9 * radii.size() || 3 * sections > contid::kMostAxes) throw nb::value_error("to_arc: (n, 3, 3)");
  new (self) SharedLengths{sections,
                           std::isfinite(rack_m) ? 3 : 0,
                           std::isfinite(curvature_max) ? sections : 0,
                           rack_m,
                           curvature_max,
                           radii,
                           rows};
}

int axes_of(const SharedLengths& shared) { return 3 * shared.sections; }
int axes_of(const SharedBend&) { return 2; }
int count_of(const SharedLengths& shared) { return shared.count(); }
int count_of(const SharedBend&) { return SharedBend::kCount; }

template <class Shared> nb::tuple excess_of(const Shared& self, nb::handle axes) {
  AxisNumbers at, over;
  read(axes, at, axes_of(self), kPerAxis);
  self.excess(at, over);
  return contid::tuple_of(over, count_of(self));
}

template <class Shared> nb::tuple gradient_of(const Shared& self, nb::handle axes, int number) {
  AxisNumbers at, slopes;
  read(axes, at, axes_of(self), kPerAxis);
  if (number < 0 || number >= count_of(self)) throw nb::index_error("number: of a limit");
  self.gradient(at, number, slopes);
  return contid::tuple_of(slopes, axes_of(self));
}

// The stop of all axes of a robot that the guard compares with its limits, as a motion:
// contid/trajectory/joint_stop.py.
class JointStopMotion {
 public:
  JointStopMotion(nb::handle state, nb::handle velocity, nb::handle acceleration, nb::handle jerk, bool straight)
      : velocity_(numbers(velocity)) {
    const std::size_t axes = velocity_.size();
    const auto most = numbers(acceleration), jolts = numbers(jerk);
    if (most.size() != axes || jolts.size() != axes || axes > contid::kMostAxes) throw nb::value_error(kPerAxis);
    contid::read_moving(state, begin_, static_cast<int>(axes), kPerAxis);
    joint_ = contid::joint_stop(begin_, velocity_, most, jolts, straight);
  }

  double duration_s() const { return joint_.duration_s; }

  nb::tuple at_time(double time_s) const {
    const int axes = static_cast<int>(velocity_.size());
    AxisNumbers position, velocity;
    for (int k = 0; k < axes; ++k) {
      const double unit = joint_.shares[k] * velocity_[k];
      const auto gone = joint_.stops[k].after(time_s);
      position[k] = begin_.position[k] + gone.way * unit, velocity[k] = gone.velocity * unit;
    }
    return nb::make_tuple(contid::tuple_of(position, axes), contid::tuple_of(velocity, axes));
  }

 private:
  std::vector<double> velocity_;
  Moving begin_;
  contid::JointStop joint_;
};

// The guard of one robot, with the limits that its axes share: of lengths, of taut tendons, or of a model in Python.
class RobotGuard {
 public:
  RobotGuard(nb::handle limits, nb::handle velocity, nb::handle acceleration, nb::handle jerk, double period_s,
             int extra_axes, int motion_rules, nb::object shared, nb::object taut, nb::handle lower, nb::handle upper)
      : guard_{0, 0, period_s, motion_rules, std::vector<contid::Axis>(contid::kMostAxes), {}, {}, {}},
        shared_(shared),
        taut_(taut) {
    guard_.axes = contid::axes_of(limits, guard_.limits.data()), guard_.own = guard_.axes - extra_axes;
    guard_.velocity = numbers(velocity), guard_.acceleration = numbers(acceleration), guard_.jerk = numbers(jerk);
    const std::size_t axes = guard_.axes;
    if (guard_.velocity.size() != axes || guard_.acceleration.size() != axes || guard_.jerk.size() != axes)
      throw nb::value_error(kPerAxis);
    if (!taut.is_none()) pulls_ = nb::cast<const TautPulls*>(taut), lower_ = numbers(lower), upper_ = numbers(upper);
    if (nb::isinstance<SharedLengths>(shared)) lengths_ = nb::cast<const SharedLengths*>(shared);
    if (nb::isinstance<SharedBend>(shared)) bend_ = nb::cast<const SharedBend*>(shared);
    if ((pulls_ && (pulls_->tendons != guard_.own || lower_.size() != upper_.size())) ||
        (lengths_ && axes_of(*lengths_) != guard_.own) || (bend_ && guard_.own != 2))
      throw nb::value_error(kPerAxis);
  }

  // By how much the shared limit that is exceeded most is exceeded [m], negative inside; convex.
  double excess(const double* axes) const {
    double over[5 * contid::kMostAxes];
    if (pulls_) {
      pulls_->excess(axes, lower_.data(), upper_.data(), over);
      return *std::max_element(over, over + pulls_->limits());
    }
    if (lengths_ || bend_) {
      lengths_ ? lengths_->excess(axes, over) : bend_->excess(axes, over);
      return *std::max_element(over, over + (lengths_ ? lengths_->count() : SharedBend::kCount));
    }
    double most = -std::numeric_limits<double>::infinity();
    if (shared_.is_none()) return most;
    for (nb::handle each : shared_.attr("excess")(contid::tuple_of(axes, guard_.own)))
      most = std::max(most, nb::cast<double>(each));
    return most;
  }

  double excess_at(nb::handle axes) const {
    AxisNumbers at;
    read(axes, at, guard_.axes, kPerAxis);
    return excess(at);
  }

  // See `contid.control.tick.limits.limit`, for the axes of this robot.
  nb::tuple limit(nb::handle last, nb::handle last_steps, nb::handle targets, nb::handle target_steps) const {
    return contid::limited(guard_.limits.data(), guard_.axes, last, last_steps, targets, target_steps);
  }

  // Whether no stop from a command gets to a limit that the axes share, by the greatest slope of these.
  bool stays_clear(nb::handle last, nb::handle command) const {
    AxisNumbers before, at;
    read(last, before, guard_.axes, kPerAxis), read(command, at, guard_.axes, kPerAxis);
    double sum = 0.0, ticks = 0.0;
    for (int k = 0; k < guard_.own; ++k) {
      const double move = std::fabs(at[k] - before[k]);
      sum += move, ticks = std::max(ticks, move / guard_.limits[k].change);
    }
    return -excess(at) > contid::kSteepest * sum * (1.0 + std::max(0.0, 0.5 * (ticks - 1.0)));
  }

  // See `contid.control.tick.jerk_guard.guarded`: the paces of the answer, the state of axes that are not on it or
  // None, whether a tendon robot stops before it goes on, and flags per axis.
  nb::tuple guarded(nb::handle answer, nb::handle last, nb::handle steps, nb::handle last_steps, nb::handle reference,
                    nb::handle last_paces, nb::object motion, bool brakes) const {
    const int n = guard_.axes;
    Moving to;
    AxisNumbers at, step, before, from, paces, paces_before;
    read(answer, to.position, n, kPerAxis), read(last, at, n, kPerAxis), read(steps, step, n, kPerAxis);
    read(last_steps, before, n, kPerAxis), read(reference, from, n, kPerAxis);
    read(last_paces, paces_before, n, kPerAxis);
    const double h = guard_.period_s;
    for (int k = 0; k < n; ++k) {
      paces[k] = to.position[k] - from[k];
      const double next = to.position[k] - at[k], change = next - step[k];
      to.velocity[k] = (next + 0.5 * change) / h, to.acceleration[k] = change / (h * h);
    }
    const bool is_on = guard_.on_answer(to.position, at, step, before, paces, paces_before) && inside(to, at);
    // By motion rules 0 the limiter of tendons alone keeps their limits, without that of jerk.
    if (is_on || (pulls_ && guard_.motion_rules == 0))
      return nb::make_tuple(contid::tuple_of(paces, n), nb::none(), false, nb::tuple());
    Moving now, found;
    const bool goes_on = !motion.is_none();
    if (goes_on) contid::read_moving(motion, now, n, kPerAxis);
    if (!goes_on || !std::equal(at, at + n, now.position))
      for (int k = 0; k < n; ++k) {
        const double change = step[k] - before[k];
        now.position[k] = at[k], now.velocity[k] = (step[k] + 0.5 * change) / h, now.acceleration[k] = change / (h * h);
      }
    AxisNumbers pace;
    for (int k = 0; k < n; ++k) pace[k] = paces[k] / h;
    const auto moves = [n](const double* rates) {
      return std::any_of(rates, rates + n, [](double v) { return v != 0.0; });
    };
    const bool stops = brakes && (moves(now.velocity) || moves(now.acceleration));
    const auto viable = [&](const Moving& state) { return guard_.all_viable(state) && inside(state, at); };
    const bool stopped = contid::CatchUp(guard_, pulls_ != nullptr).after(now, to.position, pace, stops, viable, found);
    nb::tuple flags = nb::steal<nb::tuple>(PyTuple_New(n));
    for (int k = 0; k < n; ++k) {
      double& x = found.position[k];
      // The limiter would brake all axes by their whole acceleration for one that rounding has put 1e-6 Pa too far.
      if (guard_.motion_rules > 1)
        x = std::max(std::min(x, std::max(guard_.limits[k].upper, at[k])), std::min(guard_.limits[k].lower, at[k]));
      PyTuple_SET_ITEM(flags.ptr(), k, PyLong_FromLong(x != to.position[k] ? contid::kAcceleration : 0));
    }
    const nb::tuple state = nb::make_tuple(contid::tuple_of(found.position, n), contid::tuple_of(found.velocity, n),
                                           contid::tuple_of(found.acceleration, n));
    return nb::make_tuple(contid::tuple_of(paces, n), state, stopped, flags);
  }

  bool stops_inside(nb::handle state, nb::handle last) const {
    Moving at;
    AxisNumbers before;
    contid::read_moving(state, at, guard_.axes, kPerAxis), read(last, before, guard_.axes, kPerAxis);
    return inside(at, before);
  }

  bool stays_viable(nb::handle state, nb::handle last) const {
    Moving at;
    AxisNumbers before;
    contid::read_moving(state, at, guard_.axes, kPerAxis), read(last, before, guard_.axes, kPerAxis);
    return guard_.all_viable(at) && inside(at, before);
  }

  bool viable(int axis, double at, double speed, double acceleration) const {
    if (axis < 0 || axis >= guard_.axes) throw nb::index_error("axis");
    return guard_.axis_viable(axis, at, speed, acceleration);
  }

 private:
  bool inside(const Moving& at, const double* last) const {
    if (!pulls_ && shared_.is_none()) return true;
    return guard_.stops_inside(at, last, pulls_ != nullptr, [this](const double* axes) { return excess(axes); });
  }

  contid::Guard guard_;
  nb::object shared_, taut_;
  const TautPulls* pulls_ = nullptr;
  const SharedLengths* lengths_ = nullptr;
  const SharedBend* bend_ = nullptr;
  std::vector<double> lower_, upper_;
};

}  // namespace

namespace contid {

void bind_guard(nb::module_& module) {
  nb::class_<SharedLengths>(module, "SharedLengths")
      .def("__init__", &make_lengths, nb::arg("radius_m"), nb::arg("to_arc"), nb::arg("rack_m"),
           nb::arg("curvature_max"))
      .def("excess", &excess_of<SharedLengths>, nb::arg("axes"))
      .def("gradient", &gradient_of<SharedLengths>, nb::arg("axes"), nb::arg("number"));
  nb::class_<SharedBend>(module, "SharedBend")
      .def(
          "__init__",
          [](SharedBend* self, double spacing_m, double curvature_max, double arc_min_m, double gain_per_m,
             double gain_offset, double gain_least_m, double gain_greatest_m) {
            new (self)
                SharedBend{spacing_m, curvature_max, arc_min_m, gain_per_m, gain_offset, gain_least_m, gain_greatest_m};
          },
          nb::arg("spacing_m"), nb::arg("curvature_max"), nb::arg("arc_min_m"), nb::arg("gain_per_m"),
          nb::arg("gain_offset"), nb::arg("gain_least_m"), nb::arg("gain_greatest_m"))
      .def("excess", &excess_of<SharedBend>, nb::arg("axes"))
      .def("gradient", &gradient_of<SharedBend>, nb::arg("axes"), nb::arg("number"));
  nb::class_<JointStopMotion>(module, "JointStopMotion")
      .def(nb::init<nb::handle, nb::handle, nb::handle, nb::handle, bool>(), nb::arg("state"), nb::arg("velocity"),
           nb::arg("acceleration"), nb::arg("jerk"), nb::arg("straight"))
      .def_prop_ro("duration_s", &JointStopMotion::duration_s)
      .def("at_time", &JointStopMotion::at_time, nb::arg("time_s"));
  nb::class_<RobotGuard>(module, "RobotGuard")
      .def(nb::init<nb::handle, nb::handle, nb::handle, nb::handle, double, int, int, nb::object, nb::object,
                    nb::handle, nb::handle>(),
           nb::arg("limits"), nb::arg("velocity"), nb::arg("acceleration"), nb::arg("jerk"), nb::arg("period_s"),
           nb::arg("extra_axes"), nb::arg("motion_rules"), nb::arg("shared").none(), nb::arg("taut").none(),
           nb::arg("lower"), nb::arg("upper"))
      .def("excess", &RobotGuard::excess_at, nb::arg("axes"))
      .def("limit", &RobotGuard::limit, nb::arg("last"), nb::arg("last_steps"), nb::arg("targets"),
           nb::arg("target_steps"))
      .def("stays_clear", &RobotGuard::stays_clear, nb::arg("last"), nb::arg("command"))
      .def("guarded", &RobotGuard::guarded, nb::arg("answer"), nb::arg("last"), nb::arg("steps"), nb::arg("last_steps"),
           nb::arg("reference"), nb::arg("last_paces"), nb::arg("motion").none(), nb::arg("brakes"))
      .def("stops_inside", &RobotGuard::stops_inside, nb::arg("state"), nb::arg("last"))
      .def("stays_viable", &RobotGuard::stays_viable, nb::arg("state"), nb::arg("last"))
      .def("viable", &RobotGuard::viable, nb::arg("axis"), nb::arg("at"), nb::arg("speed"), nb::arg("acceleration"));
}

}  // namespace contid

// Jerk-limited motions for Python. Short calls, under the GIL.
#include <nanobind/nanobind.h>

#include "../limiter/axis_records.hpp"
#include "../python.hpp"
#include "pursuit.hpp"
#include "rest_motion.hpp"

namespace nb = nanobind;
using contid::AxisNumbers, contid::AxisRates, contid::Lines, contid::Moving, contid::read, contid::RestMotion,
    contid::tuple_of;

namespace {

constexpr char kPerAxis[] = "motion: one number per axis";

// Rates of axes that are read from three sequences.
struct Rates {
  explicit Rates(nb::handle three) {
    const Py_ssize_t count = PyObject_Length(nb::object(three[0]).ptr());
    if (count < 1 || count > contid::kMostAxes) throw nb::value_error(kPerAxis);
    read(three[0], velocity, count, kPerAxis), read(three[1], acceleration, count, kPerAxis);
    read(three[2], jerk, count, kPerAxis);
    of = {static_cast<int>(count), velocity, acceleration, jerk};
  }
  Rates(const Rates&) = delete;
  AxisNumbers velocity, acceleration, jerk;
  AxisRates of;
};

nb::object found(bool any, const Moving& state, int axes) {
  if (!any) return nb::none();
  return nb::make_tuple(tuple_of(state.position, axes), tuple_of(state.velocity, axes),
                        tuple_of(state.acceleration, axes));
}

nb::object pursued_state(nb::handle state, nb::handle goal, nb::handle frame, nb::handle rates, double time_s,
                         bool together, int lines) {
  const Rates limits(rates);
  Moving from, after;
  AxisNumbers to, moves;
  contid::read_moving(state, from, limits.of.axes, kPerAxis);
  read(goal, to, limits.of.axes, kPerAxis), read(frame, moves, limits.of.axes, kPerAxis);
  const bool any = contid::pursued(from, to, moves, limits.of, time_s, together, static_cast<Lines>(lines), after);
  return found(any, after, limits.of.axes);
}

nb::object braked_state(nb::handle state, nb::handle rates, double time_s, bool together, int lines) {
  const Rates limits(rates);
  Moving from, after;
  contid::read_moving(state, from, limits.of.axes, kPerAxis);
  const bool any = contid::braked(from, limits.of, time_s, together, static_cast<Lines>(lines), after);
  return found(any, after, limits.of.axes);
}

nb::tuple frame_of(nb::handle pace, nb::handle rates) {
  const Rates limits(rates);
  AxisNumbers moves, frame;
  read(pace, moves, limits.of.axes, kPerAxis);
  contid::frame_velocity(moves, limits.of, frame);
  return tuple_of(frame, limits.of.axes);
}

void make_rest(RestMotion* self, nb::handle start, nb::handle velocity, nb::handle goal, nb::handle fastest,
               nb::handle most, nb::handle jerk, bool straight, nb::handle acceleration) {
  const Py_ssize_t axes = PyObject_Length(goal.ptr()), known = PyObject_Length(acceleration.ptr());
  if (axes < 1 || axes > contid::kMostAxes || known < 0) throw nb::value_error(kPerAxis);
  const auto numbers = [](nb::handle of, Py_ssize_t count) {
    std::vector<double> values(count);
    read(of, values.data(), count, kPerAxis);
    return values;
  };
  new (self) RestMotion({numbers(start, axes), numbers(velocity, axes), numbers(acceleration, known ? axes : 0),
                         numbers(goal, axes), numbers(fastest, axes), numbers(most, axes), numbers(jerk, axes)},
                        straight);
}

nb::tuple rest_at(const RestMotion& self, double time_s) {
  Moving at;
  self.at(time_s, at);
  return nb::make_tuple(tuple_of(at.position, self.axes()), tuple_of(at.velocity, self.axes()));
}

nb::tuple rest_acceleration(const RestMotion& self, double time_s) {
  Moving at;
  self.at(time_s, at);
  return tuple_of(at.acceleration, self.axes());
}

}  // namespace

namespace contid {

void bind_motion(nb::module_& module) {
  module.def("frame_velocity", &frame_of, nb::arg("pace"), nb::arg("rates"));
  module.def("pursued", &pursued_state, nb::arg("state"), nb::arg("goal"), nb::arg("frame"), nb::arg("rates"),
             nb::arg("time_s"), nb::arg("together"), nb::arg("lines"));
  module.def("braked", &braked_state, nb::arg("state"), nb::arg("rates"), nb::arg("time_s"), nb::arg("together"),
             nb::arg("lines"));
  nb::class_<RestMotion>(module, "RestMotion")
      .def("__init__", &make_rest, nb::arg("start"), nb::arg("velocity"), nb::arg("goal"), nb::arg("fastest"),
           nb::arg("most"), nb::arg("jerk"), nb::arg("straight"), nb::arg("acceleration"))
      .def_prop_ro("duration", &RestMotion::duration_s)
      .def("at_time", &rest_at, nb::arg("time_s"))
      .def("acceleration_at", &rest_acceleration, nb::arg("time_s"));
}

}  // namespace contid

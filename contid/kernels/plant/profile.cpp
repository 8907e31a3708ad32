// Simulated devices and their motions for Python.
#include "device.hpp"

#include <nanobind/nanobind.h>

namespace nb = nanobind;
using contid::DeviceNumbers, contid::Phase, contid::Phases, contid::ProfileMotion, contid::SimulatedDevice;

namespace {

nb::tuple of_state(const contid::ProfileState& state) { return nb::make_tuple(state.position, state.velocity); }

nb::list of_phases(const Phases& phases) {
  nb::list found;
  for (int k = 0; k < phases.count; ++k) found.append(phases.of[k]);
  return found;
}

nb::list planned(double t_s, double position, double velocity, double goal, double v_max, double a_max) {
  Phases phases;
  contid::plan(t_s, {position, velocity}, goal, v_max, a_max, phases);
  return of_phases(phases);
}

nb::list planned_to_moving(double t_s, double position, double velocity, double goal, double rate, double until_s,
                           double v_max, double a_max) {
  Phases phases;
  contid::plan_to_moving(t_s, {position, velocity}, {goal, rate, until_s}, v_max, a_max, phases);
  return of_phases(phases);
}

void go_with(ProfileMotion& self, double goal, double rate, double until_s, double v_max, double a_max) {
  self.go_with({goal, rate, until_s}, v_max, a_max);
}

void make_device(SimulatedDevice* self, double time_s, double value, double tau_s, double top, double quantum,
                 double velocity_quantum, double lowest, double highest, double acceleration, double current_limit_a,
                 double overload_s, double amperes_per_lag, bool streams) {
  const DeviceNumbers numbers{quantum,         velocity_quantum, lowest,          highest, acceleration,
                              current_limit_a, overload_s,       amperes_per_lag, streams};
  new (self) SimulatedDevice(time_s, value, tau_s, top, numbers);
}

// Position, velocity, current and temperature.
nb::tuple reading(const SimulatedDevice& self, double noise) {
  const contid::DeviceReading now = self.read(noise);
  return nb::make_tuple(now.value, now.velocity, now.current_a, now.temperature_c);
}

void bear(SimulatedDevice& self, double shaft, double current_a) {
  self.borne = true, self.shaft = shaft, self.borne_a = current_a;
}

}  // namespace

namespace contid {

void bind_profile(nb::module_& module) {
  nb::class_<Phase>(module, "Phase")
      .def_ro("start_s", &Phase::start_s)
      .def_ro("position", &Phase::position)
      .def_ro("velocity", &Phase::velocity)
      .def_ro("acceleration", &Phase::acceleration)
      .def("at", [](const Phase& self, double t_s) { return of_state(self.at(t_s)); }, nb::arg("t_s"));
  module.def("plan", &planned, nb::arg("t_s"), nb::arg("position"), nb::arg("velocity"), nb::arg("goal"),
             nb::arg("v_max"), nb::arg("a_max"));
  module.def("plan_to_moving", &planned_to_moving, nb::arg("t_s"), nb::arg("position"), nb::arg("velocity"),
             nb::arg("goal"), nb::arg("rate"), nb::arg("until_s"), nb::arg("v_max"), nb::arg("a_max"));
  nb::class_<ProfileMotion>(module, "ProfileMotion")
      .def(nb::init<double, double, double>(), nb::arg("time_s"), nb::arg("value"), nb::arg("tau_s"))
      .def_ro("time_s", &ProfileMotion::time_s)
      .def_rw("value", &ProfileMotion::value)
      .def_rw("tau_s", &ProfileMotion::tau_s)
      .def_rw("blocked", &ProfileMotion::blocked)
      .def_prop_ro("reference", [](const ProfileMotion& self) { return of_state(self.reference()); })
      .def_prop_ro("velocity", &ProfileMotion::velocity)
      .def("go", &ProfileMotion::go, nb::arg("goal"), nb::arg("v_max"), nb::arg("a_max"))
      .def("go_with", &go_with, nb::arg("goal"), nb::arg("rate"), nb::arg("until_s"), nb::arg("v_max"),
           nb::arg("a_max"))
      .def("stop", &ProfileMotion::stop)
      .def("freeze", &ProfileMotion::freeze)
      .def("advance", &ProfileMotion::advance, nb::arg("to_s"));
  nb::class_<SimulatedDevice, ProfileMotion>(module, "SimulatedDevice")
      .def("__init__", &make_device, nb::arg("time_s"), nb::arg("value"), nb::arg("tau_s"), nb::arg("top"),
           nb::arg("quantum"), nb::arg("velocity_quantum"), nb::arg("lowest"), nb::arg("highest"),
           nb::arg("acceleration"), nb::arg("current_limit_a"), nb::arg("overload_s"), nb::arg("amperes_per_lag"),
           nb::arg("streams"))
      .def_rw("top", &SimulatedDevice::top)
      .def_rw("powered", &SimulatedDevice::powered)
      .def_rw("saturated_s", &SimulatedDevice::saturated_s)
      .def("advance", &SimulatedDevice::advance, nb::arg("to_s"))
      .def("bear", &bear, nb::arg("shaft"), nb::arg("current_a"))
      .def("switch_on", &SimulatedDevice::switch_on)
      .def("command", &SimulatedDevice::command, nb::arg("value"))
      .def("read", &reading, nb::arg("noise"));
}

}  // namespace contid

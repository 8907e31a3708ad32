// Records of `contid.control.tick.limits.AxisLimits` for the kernels.
#pragma once

#include <nanobind/nanobind.h>

#include "../python.hpp"
#include "axis.hpp"
#include "axis_numbers.hpp"

namespace contid {

inline Axis axis_of(nanobind::handle limits) {
  static PyObject* const names[4] = {PyUnicode_InternFromString("lower"), PyUnicode_InternFromString("upper"),
                                     PyUnicode_InternFromString("step"), PyUnicode_InternFromString("change")};
  double values[4];
  for (int k = 0; k < 4; ++k) {
    const nanobind::object value = nanobind::steal(PyObject_GetAttr(limits.ptr(), names[k]));
    if (!value.is_valid()) throw nanobind::python_error();
    values[k] = PyFloat_AsDouble(value.ptr());
  }
  if (PyErr_Occurred()) throw nanobind::python_error();
  return {values[0], values[1], values[2], values[3]};
}

inline int axes_of(nanobind::handle limits, Axis* axes) {
  const nanobind::object fast = nanobind::steal(PySequence_Fast(limits.ptr(), "limits: a sequence"));
  if (!fast.is_valid()) throw nanobind::python_error();
  const Py_ssize_t count = PySequence_Fast_GET_SIZE(fast.ptr());
  if (count > kMostAxes) throw nanobind::value_error("limits: too many axes");
  for (Py_ssize_t k = 0; k < count; ++k) axes[k] = axis_of(PySequence_Fast_GET_ITEM(fast.ptr(), k));
  return static_cast<int>(count);
}

// The next command of every axis, and per axis the limits that bound: `contid.control.tick.limits.limit`.
inline nanobind::tuple limited(const Axis* axes, int count, nanobind::handle last, nanobind::handle last_steps,
                               nanobind::handle targets, nanobind::handle target_steps) {
  constexpr char what[] = "limit: one number per axis";
  AxisNumbers at, steps, to, paces, commands;
  read(last, at, count, what), read(last_steps, steps, count, what);
  read(targets, to, count, what), read(target_steps, paces, count, what);
  nanobind::tuple flags = nanobind::steal<nanobind::tuple>(PyTuple_New(count));
  for (int k = 0; k < count; ++k) {
    const AxisCommand next = limit_axis(axes[k], at[k], steps[k], to[k], paces[k]);
    commands[k] = next.value;
    PyTuple_SET_ITEM(flags.ptr(), k, PyLong_FromLong(next.flags));
  }
  return nanobind::make_tuple(tuple_of(commands, count), flags);
}

// A `contid.trajectory.pursuit.MovingAxes`.
inline void read_moving(nanobind::handle state, Moving& out, int axes, const char* what) {
  read(state[0], out.position, axes, what), read(state[1], out.velocity, axes, what);
  read(state[2], out.acceleration, axes, what);
}

}  // namespace contid

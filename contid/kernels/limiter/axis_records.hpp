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

// A `contid.trajectory.pursuit.MovingAxes`.
inline void read_moving(nanobind::handle state, Moving& out, int axes, const char* what) {
  read(state[0], out.position, axes, what), read(state[1], out.velocity, axes, what);
  read(state[2], out.acceleration, axes, what);
}

}  // namespace contid

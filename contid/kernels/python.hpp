// Numbers from Python and back, for the bindings of all kernels.
#pragma once

#include <nanobind/nanobind.h>

namespace contid {

// What modules.hpp calls.
void bind(nanobind::module_& module);

// `count` floats of any sequence, without a temporary; raises ValueError(what) for another length.
inline void read(nanobind::handle sequence, double* out, Py_ssize_t count, const char* what) {
  const nanobind::object fast = nanobind::steal(PySequence_Fast(sequence.ptr(), what));
  if (!fast.is_valid()) throw nanobind::python_error();
  if (PySequence_Fast_GET_SIZE(fast.ptr()) != count) throw nanobind::value_error(what);
  for (Py_ssize_t i = 0; i < count; ++i) out[i] = PyFloat_AsDouble(PySequence_Fast_GET_ITEM(fast.ptr(), i));
  if (PyErr_Occurred()) throw nanobind::python_error();
}

inline nanobind::tuple tuple_of(const double* values, Py_ssize_t count) {
  nanobind::tuple result = nanobind::steal<nanobind::tuple>(PyTuple_New(count));
  for (Py_ssize_t i = 0; i < count; ++i) PyTuple_SET_ITEM(result.ptr(), i, PyFloat_FromDouble(values[i]));
  return result;
}

}  // namespace contid

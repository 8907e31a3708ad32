// Arrays of NumPy in the bindings of kernels.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <vector>

namespace contid {

// Filled for the caller: its arguments are `noconvert`, or a copy would be filled and lost.
using Rows = nanobind::ndarray<double, nanobind::c_contig, nanobind::device::cpu>;
using Given = nanobind::ndarray<const double, nanobind::c_contig, nanobind::device::cpu>;

// The numbers of an array; raises ValueError(what) for another count.
inline std::vector<double> numbers(const Given& given, size_t count, const char* what) {
  if (given.size() != count) throw nanobind::value_error(what);
  return {given.data(), given.data() + count};
}

}  // namespace contid

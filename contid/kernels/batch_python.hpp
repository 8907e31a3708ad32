// Arrays of a batch from Python, their shapes checked.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "batch.hpp"

namespace contid {

using Matrix = nanobind::ndarray<const double, nanobind::c_contig, nanobind::device::cpu>;
using Table = nanobind::ndarray<std::uint8_t, nanobind::c_contig, nanobind::device::cpu>;

inline void check(const Matrix& array, std::size_t rows, std::size_t columns, const char* what) {
  if (array.ndim() != 2 || array.shape(0) != rows || array.shape(1) != columns) throw nanobind::value_error(what);
}

inline void check(const Table& table, std::size_t rows, std::size_t bytes) {
  if (table.ndim() != 2 || table.shape(0) != rows || table.shape(1) != bytes)
    throw nanobind::value_error("rows: not the layout of the results");
}

// Targets of `rows` rows from (tip, direction, mid, load); None for those that are not given.
inline TargetRows targets_of(const Matrix& tip, nanobind::handle direction, nanobind::handle mid,
                             nanobind::handle load) {
  const std::size_t rows = tip.ndim() == 2 ? tip.shape(0) : 0;
  check(tip, rows, 3, "tip: an array (rows, 3)");
  const auto vectors = [rows](nanobind::handle given, const char* what) -> const double* {
    if (given.is_none()) return nullptr;
    const Matrix array = nanobind::cast<Matrix>(given);  // a view: the caller keeps the data
    check(array, rows, 3, what);
    return array.data();
  };
  return {tip.data(), vectors(direction, "direction: an array (rows, 3)"), vectors(mid, "mid: an array (rows, 3)"),
          vectors(load, "load: an array (rows, 3)")};
}

}  // namespace contid

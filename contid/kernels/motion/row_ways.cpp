// The ways from expected rows of a stream to those that came, and the spline through rows: the numbers of
// `contid.control.engine.live.row_curve`, which has the rules. To the bit those of the same steps in Python.
#include <nanobind/nanobind.h>

#include <cmath>
#include <vector>

#include "../limiter/axis_numbers.hpp"
#include "../python.hpp"

namespace nb = nanobind;
using contid::AxisNumbers, contid::read, contid::tuple_of;

namespace {

constexpr char kRow[] = "rows: one number per coordinate";

Py_ssize_t size_of(nb::handle row) {
  const Py_ssize_t size = PyObject_Length(row.ptr());
  if (size < 0) throw nb::python_error();
  if (size > contid::kMostAxes) throw nb::value_error(kRow);
  return size;
}

class RowWays {
 public:
  // `size`: coordinates of a row; `most`: ways at once.
  RowWays(Py_ssize_t size, std::size_t most) : size_(size), most_(most) {
    ways_.reserve(most), offs_.resize(most * static_cast<std::size_t>(size));
  }

  void clear() { ways_.clear(); }
  bool full() const { return ways_.size() == most_; }

  // Leaves out the ways that have ended before a row.
  void forget(long number) {
    std::size_t kept = 0;
    for (std::size_t k = 0; k < ways_.size(); ++k) {
      if (!(static_cast<double>(number - ways_[k].number) < ways_[k].rows)) continue;
      if (kept != k) {
        ways_[kept] = ways_[k];
        for (Py_ssize_t j = 0; j < size_; ++j) off(kept)[j] = off(k)[j];
      }
      ++kept;
    }
    ways_.resize(kept);
  }

  // How far the curve is from the row of a number; false where it is on it.
  bool off_at(long number, double* sum) const {
    bool any = false;
    for (std::size_t k = 0; k < ways_.size(); ++k) {
      const double since = static_cast<double>(number - ways_[k].number);
      if (!(since < ways_[k].rows)) continue;
      // The rest of a quintic from 1 to 0, at rest at both ends.
      const double x = since / ways_[k].rows;
      const double share = 1.0 - std::pow(x, 3.0) * (10.0 - 15.0 * x + 6.0 * x * x);
      for (Py_ssize_t j = 0; j < size_; ++j) sum[j] = any ? sum[j] + share * off(k)[j] : share * off(k)[j];
      any = true;
    }
    return any;
  }

  nb::object moved(nb::handle row, long number) const {
    AxisNumbers sum, at;
    if (!off_at(number, sum)) return nb::borrow(row);
    read(row, at, size_, kRow);
    for (Py_ssize_t j = 0; j < size_; ++j) at[j] = at[j] + sum[j];
    return tuple_of(at, size_);
  }

  // A row came where another was used. A distance on its way goes on, but for what is left behind already: none leads
  // past the rows.
  void came(long number, nb::handle row, nb::handle used, double rows) {
    AxisNumbers at, before, left = {};
    read(row, at, size_, kRow), read(used, before, size_, kRow);
    off_at(number, left);
    if (full()) throw nb::value_error("rows: too many ways");
    double* const added = off(ways_.size());
    for (Py_ssize_t j = 0; j < size_; ++j) {
      const double away = before[j] - at[j];
      double kept = 0.0;
      if (left[j] != 0.0) {
        kept = away / left[j];
        kept = 0.0 > kept ? 0.0 : kept;
        kept = 1.0 < kept ? 1.0 : kept;
      }
      added[j] = away - kept * left[j];
      for (std::size_t k = 0; k < ways_.size(); ++k) off(k)[j] = kept * off(k)[j];
    }
    ways_.push_back({number, rows});
  }

 private:
  struct Way {
    long number;  // of the last row that was used
    double rows;  // length
  };

  double* off(std::size_t way) { return &offs_[way * static_cast<std::size_t>(size_)]; }
  const double* off(std::size_t way) const { return &offs_[way * static_cast<std::size_t>(size_)]; }

  Py_ssize_t size_;
  std::size_t most_;
  std::vector<Way> ways_;
  std::vector<double> offs_;  // how far the row that was used was from the one that came, of each way
};

// The uniform cubic B-spline at a share u of the way between the two middle ones of four rows.
nb::tuple between(nb::handle first, nb::handle second, nb::handle third, nb::handle fourth, double u) {
  AxisNumbers a, b, c, d;
  const Py_ssize_t size = size_of(first);
  read(first, a, size, kRow), read(second, b, size, kRow), read(third, c, size, kRow), read(fourth, d, size, kRow);
  const double v = 1.0 - u, uu = u * u, uuu = uu * u;
  const double w0 = v * v * v / 6.0, w1 = (4.0 - 6.0 * uu + 3.0 * uuu) / 6.0;
  const double w2 = (1.0 + 3.0 * u + 3.0 * uu - 3.0 * uuu) / 6.0, w3 = uuu / 6.0;
  for (Py_ssize_t j = 0; j < size; ++j) a[j] = w0 * a[j] + w1 * b[j] + w2 * c[j] + w3 * d[j];
  return tuple_of(a, size);
}

void make(RowWays* self, nb::handle row, std::size_t most) { new (self) RowWays(size_of(row), most); }

}  // namespace

namespace contid {

void bind_rows(nb::module_& module) {
  module.def("between_rows", &between, nb::arg("first"), nb::arg("second"), nb::arg("third"), nb::arg("fourth"),
             nb::arg("share"));
  nb::class_<RowWays>(module, "RowWays")
      .def("__init__", &make, nb::arg("row"), nb::arg("most"))
      .def("clear", &RowWays::clear)
      .def_prop_ro("full", &RowWays::full)
      .def("forget", &RowWays::forget, nb::arg("number"))
      .def("moved", &RowWays::moved, nb::arg("row"), nb::arg("number"))
      .def("came", &RowWays::came, nb::arg("number"), nb::arg("row"), nb::arg("used"), nb::arg("rows"));
}

}  // namespace contid

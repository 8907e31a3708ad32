// contid.kernels._text: rows of numbers as lines of CSV.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <vector>

namespace nb = nanobind;

namespace {

using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

constexpr std::size_t kNumberBytes = 32;  // enough for any number

// Copies a word to `to`; returns the end.
char* put(const char* word, char* to) { return std::copy_n(word, std::strlen(word), to); }

// The bytes of Python's repr: the fewest digits that are read as x again, without an exponent from 1e-4 to below 1e16.
// Returns the end.
char* write_number(double x, char* to) {
#ifdef __cpp_lib_to_chars
  if (std::isnan(x)) return put("nan", to);  // whatever its sign
  const double size = std::fabs(x);
  const bool fixed = size == 0.0 || (size >= 1e-4 && size < 1e16);
  const auto form = fixed ? std::chars_format::fixed : std::chars_format::scientific;
  char* const end = std::to_chars(to, to + kNumberBytes, x, form).ptr;
  return fixed && std::find(to, end, '.') == end ? put(".0", end) : end;
#else  // g++ before 11
  char* const text = PyOS_double_to_string(x, 'r', 0, Py_DTSF_ADD_DOT_0, nullptr);
  if (!text) throw nb::python_error();
  char* const end = put(text, to);
  PyMem_Free(text);
  return end;
#endif
}

nb::list joined(Rows rows) {
  const std::size_t count = rows.shape(0), columns = rows.shape(1);
  nb::list lines = nb::steal<nb::list>(PyList_New(static_cast<Py_ssize_t>(count)));
  if (!lines.is_valid()) throw nb::python_error();
  std::vector<char> line((kNumberBytes + 1) * columns + 1);
  for (std::size_t k = 0; k < count; ++k) {
    char* end = line.data();
    for (std::size_t j = 0; j < columns; ++j) {
      if (j > 0) *end++ = ',';
      end = write_number(rows.data()[k * columns + j], end);
    }
    PyObject* text = PyUnicode_DecodeASCII(line.data(), end - line.data(), nullptr);
    if (!text) throw nb::python_error();
    PyList_SET_ITEM(lines.ptr(), static_cast<Py_ssize_t>(k), text);
  }
  return lines;
}

}  // namespace

NB_MODULE(KERNEL_MODULE, module) {
  module.doc() = "Rows of numbers as lines of CSV.";
  module.def("joined", &joined, nb::arg("rows"), "A line of comma-separated numbers per row, each as repr writes it.");
}

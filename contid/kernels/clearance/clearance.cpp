// contid.kernels._clearance: distances of bodies and obstacles for Python. Units: m.
//
// Points of a curve have shape (n, 3), at equal arc length `spacing`. A distance that is certainly at least `enough` is
// not computed further. extras/clearance/contid_clearance/distances.py calls this.
#include "../record.hpp"
#include "obstacle.hpp"

#include <nanobind/ndarray.h>

namespace nb = nanobind;

namespace {

using Points = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// The curve of an array, which has to outlive it.
contid::Curve curve(const Points& points, double spacing) {
  if (points.shape(0) < 2 || points.shape(1) != 3) throw nb::value_error("points: an array (2 or more, 3)");
  double sum = 0.0;  // a point that is not a number would be nowhere, thus far away
  for (std::size_t k = 0; k < points.size(); ++k) sum += 0.0 * points.data()[k];
  if (!(sum == 0.0)) throw nb::value_error("points: all of them must be finite");
  return {points.data(), static_cast<int>(points.shape(0)) - 1, spacing};
}

// Bounds count points and the pieces between them, thus in halves; Python gets indices of points, such as 2.5 for the
// piece after point 2.
nb::object result(const contid::Bounds& found) {
  static const contid::Record record("contid.kernels.Bounds", {"lower", "upper", "at", "other_at"});
  return record(found.lower, found.upper, 0.5 * found.at, 0.5 * found.other_at);
}

nb::object between(Points a, double a_spacing, Points b, double b_spacing, double enough) {
  return result(contid::between(curve(a, a_spacing), curve(b, b_spacing), enough));
}

// Of one curve, of parts that are at least `gap` pieces apart.
nb::object itself(Points points, double spacing, int gap, double enough) {
  const contid::Curve body = curve(points, spacing);
  if (!(gap >= 1 && gap <= body.pieces)) throw nb::value_error("gap: at least 1 piece, at most all of them");
  return result(contid::between(body, body, enough, gap));
}

// `obstacle` is as contid::Obstacle takes it: kind, point, vector, rotation, radius.
nb::object to_obstacle(Points points, double spacing, Numbers obstacle, double enough) {
  if (obstacle.shape(0) != 17) throw nb::value_error("obstacle: 17 numbers");
  return result(contid::to_obstacle(curve(points, spacing), contid::Obstacle(obstacle.data()), enough));
}

}  // namespace

NB_MODULE(KERNEL_MODULE, module) {
  module.doc() = "Bounds of the distance between bodies, and from bodies to obstacles.";
  module.def("between", &between, nb::arg("a"), nb::arg("a_spacing"), nb::arg("b"), nb::arg("b_spacing"),
             nb::arg("enough"));
  module.def("itself", &itself, nb::arg("points"), nb::arg("spacing"), nb::arg("gap"), nb::arg("enough"));
  module.def("to_obstacle", &to_obstacle, nb::arg("points"), nb::arg("spacing"), nb::arg("obstacle"),
             nb::arg("enough"));
}

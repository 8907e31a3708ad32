// contid.kernels._ph_curve: Pythagorean-hodograph quintics for Python. Calls take microseconds and hold the GIL.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <stdexcept>
#include <vector>

#include "../python.hpp"
#include "../record.hpp"
#include "inverse.hpp"

namespace nb = nanobind;
using namespace contid::ph;
using contid::tuple_of;

namespace {

constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();

class ShapeInverse {
 public:
  ShapeInverse(const std::vector<double>& distances, const std::vector<std::vector<double>>& angles,
               const std::vector<double>& split) {
    arm_.sections = static_cast<int>(distances.size());
    arm_.tubes = angles.empty() ? 0 : static_cast<int>(angles[0].size());
    if (arm_.sections < 1 || arm_.sections > max_sections || arm_.tubes > max_tubes ||
        angles.size() != distances.size() || split.size() != distances.size())
      throw std::invalid_argument("1 to 8 sections of up to 8 tubes, one distance and one share for each");
    for (int s = 0; s < arm_.sections; ++s) {
      if (static_cast<int>(angles[s].size()) != arm_.tubes)
        throw std::invalid_argument("every section has the same number of tubes");
      arm_.split[s] = split[s];
      for (int t = 0; t < arm_.tubes; ++t) {
        arm_.offset_cos[s][t] = distances[s] * std::cos(angles[s][t]);
        arm_.offset_sin[s][t] = distances[s] * std::sin(angles[s][t]);
      }
    }
  }

  nb::object solve(double x, double y, double z, double ax, double ay, double az, double length) const {
    const Inverse found = inverse(arm_, {x, y, z}, {ax, ay, az}, length);
    static const contid::Record record("contid.kernels.ShapeSolution", {"lengths_m", "length_met"});
    return record(tuple_of(found.lengths, arm_.sections * arm_.tubes), found.length_met);
  }

  // Rows of (x, y, z, ax, ay, az, length) to rows of tube lengths in `out`.
  void solve_rows(nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu> poses,
                  nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu> out) const {
    const size_t width = static_cast<size_t>(arm_.sections * arm_.tubes);
    if (poses.shape(1) != 7 || out.shape(1) != width || out.shape(0) != poses.shape(0))
      throw std::invalid_argument("poses are (n, 7), out is (n, sections * tubes)");
    for (size_t row = 0; row < poses.shape(0); ++row) {
      const double* p = poses.data() + 7 * row;
      const Inverse found = inverse(arm_, {p[0], p[1], p[2]}, {p[3], p[4], p[5]}, p[6]);
      for (size_t i = 0; i < width; ++i) out.data()[row * width + i] = found.lengths[i];
    }
  }

 private:
  Arm arm_;
};

// The preimage has twelve numbers.
nb::object fit_through(double x, double y, double z, const std::vector<double>& t0, const std::vector<double>& t1,
                       double length, double beta, double gamma) {
  if (t0.size() != 3 || t1.size() != 3) throw std::invalid_argument("directions have three components");
  const Fit fit = through({x, y, z}, {t0[0], t0[1], t0[2]}, {t1[0], t1[1], t1[2]}, length, beta, gamma);
  static const contid::Record record("contid.kernels.PhFit", {"end_speed_m", "length_m", "length_met", "preimage"});
  return record(fit.end_speed, fit.length, fit.length_met, tuple_of(&fit.preimage[0][0], 12));
}

// The lowest of `samples` points of the curve of a length through two ends, from its start.
nb::tuple lowest_point(double x, double y, double z, double ux, double uy, double uz, double vx, double vy, double vz,
                       double length, int samples) {
  if (samples < 2) throw std::invalid_argument("at least two samples");
  const Vec found = lowest(through({x, y, z}, {ux, uy, uz}, {vx, vy, vz}, length, 0.0, 0.0).preimage, samples);
  return tuple_of(found.data(), 3);
}

}  // namespace

NB_MODULE(_ph_curve, module) {
  module.doc() = "Pythagorean-hodograph quintics, and tube lengths along them.";
  nb::class_<ShapeInverse>(module, "ShapeInverse")
      .def(nb::init<const std::vector<double>&, const std::vector<std::vector<double>>&, const std::vector<double>&>(),
           nb::arg("distances_m"), nb::arg("angles_rad"), nb::arg("split"))
      .def("solve", &ShapeInverse::solve, nb::arg("x"), nb::arg("y"), nb::arg("z"), nb::arg("ax"), nb::arg("ay"),
           nb::arg("az"), nb::arg("length") = nan_value)
      .def("solve_rows", &ShapeInverse::solve_rows, nb::arg("poses"), nb::arg("out").noconvert());
  module.def("lowest", &lowest_point);
  module.def("through", &fit_through, nb::arg("x"), nb::arg("y"), nb::arg("z"), nb::arg("start_direction"),
             nb::arg("end_direction"), nb::arg("length") = nan_value, nb::arg("beta") = 0.0, nb::arg("gamma") = 0.0);
}

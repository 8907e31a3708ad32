// contid.kernels._limiter: the limits of a tick for Python. Short calls, under the GIL.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "../python.hpp"
#include "axis_records.hpp"
#include "chord.hpp"
#include "taut.hpp"

namespace nb = nanobind;
using contid::Axis, contid::axes_of, contid::axis_of, contid::AxisCommand, contid::kMostAxes, contid::kMostColumns,
    contid::read;

namespace {

constexpr int kTension = 16;

using Grid = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Row = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Written = nb::ndarray<double, nb::c_contig, nb::device::cpu>;
using Bounds = nb::ndarray<signed char, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

nb::tuple numbers_of(const int* values, int count) {
  nb::tuple result = nb::steal<nb::tuple>(PyTuple_New(count));
  for (int k = 0; k < count; ++k) PyTuple_SET_ITEM(result.ptr(), k, PyLong_FromLong(values[k]));
  return result;
}

nb::tuple limit_axis(nb::handle limits, double last, double last_step, double target, double target_step) {
  const AxisCommand next = contid::limit_axis(axis_of(limits), last, last_step, target, target_step);
  return nb::make_tuple(next.value, next.flags);
}

nb::tuple limit(nb::handle limits, nb::handle last, nb::handle last_steps, nb::handle targets,
                nb::handle target_steps) {
  Axis axes[kMostAxes];
  return contid::limited(axes, contid::axes_of(limits, axes), last, last_steps, targets, target_steps);
}

// How many of the first targets (a row per tick) `limit` commands as they are.
std::size_t followed(nb::handle limits, nb::handle last, nb::handle last_steps, Grid targets) {
  constexpr char what[] = "followed: one number per axis";
  Axis axes[kMostAxes];
  double at[kMostAxes], steps[kMostAxes];
  const int count = axes_of(limits, axes);
  read(last, at, count, what), read(last_steps, steps, count, what);
  if (targets.shape(1) != static_cast<std::size_t>(count)) throw nb::value_error(what);
  for (std::size_t row = 0; row < targets.shape(0); ++row) {
    const double* const to = targets.data() + row * count;
    for (int k = 0; k < count; ++k) {
      const double pace = to[k] - at[k];
      const AxisCommand next = contid::limit_axis(axes[k], at[k], steps[k], to[k], pace);
      if (next.flags || next.value != to[k]) return row;
    }
    for (int k = 0; k < count; ++k) steps[k] = to[k] - at[k], at[k] = to[k];
  }
  return targets.shape(0);
}

nb::tuple allowed_steps(nb::handle limits, double last, double last_step) {
  const contid::Steps steps = contid::allowed_steps(axis_of(limits), last, last_step);
  return nb::make_tuple(steps.low, steps.high);
}

void make(contid::TautPulls* self, Grid demand, Grid pull_matrix, Grid bends_by_pulls, Grid variables_by_pulls,
          Row slack_free, Row rest, Row stiffness,
          nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig> section_of, Row bend_max, double floor,
          double limit) {
  const std::size_t tendons = slack_free.shape(0), sections = bend_max.shape(0);
  if (tendons > contid::kMostTendons) throw nb::value_error("too many tendons");
  const auto is = [](const Grid& grid, std::size_t rows, std::size_t columns) {
    return grid.shape(0) == rows && grid.shape(1) == columns;
  };
  if (!is(demand, tendons, 2 * sections) || !is(pull_matrix, tendons, 2 * sections) ||
      !is(bends_by_pulls, 2 * sections, tendons) || !is(variables_by_pulls, 2 * sections, tendons) ||
      rest.shape(0) != tendons || stiffness.shape(0) != tendons || section_of.shape(0) != tendons || sections > tendons)
    throw nb::value_error("shapes that do not fit each other");
  contid::TautPulls made{
      static_cast<int>(tendons), static_cast<int>(sections), floor, limit, {}, {}, {}, {}, {}, {}, {}, {}, {}};
  const auto copy = [](auto& to, const auto& from) { to.assign(from.data(), from.data() + from.size()); };
  copy(made.demand, demand), copy(made.pull_matrix, pull_matrix), copy(made.bends_by_pulls, bends_by_pulls);
  copy(made.variables_by_pulls, variables_by_pulls), copy(made.slack_free, slack_free), copy(made.rest_n, rest);
  copy(made.n_per_m, stiffness), copy(made.section_of, section_of), copy(made.bend_max_m, bend_max);
  for (const int s : made.section_of)
    if (s < 0 || s >= made.sections) throw nb::value_error("section_of: no such section");
  new (self) contid::TautPulls(std::move(made));
}

// See `contid.kinematics.tendon.taut.TautPulls.limit`.
nb::tuple limit_taut(const contid::TautPulls& self, nb::handle limits, nb::handle last, nb::handle last_steps,
                     nb::handle answer, nb::handle answer_steps, nb::object command, nb::object flags) {
  constexpr char what[] = "limit: one number per tendon";
  const int count = self.tendons;
  Axis axes[kMostAxes];
  contid::Pulls at, steps, to, paces, candidate, next;
  double bits[contid::kMostTendons];
  if (axes_of(limits, axes) != count) throw nb::value_error(what);
  read(last, at, count, what), read(last_steps, steps, count, what), read(command, candidate, count, what);
  read(answer, to, count, what), read(answer_steps, paces, count, what), read(flags, bits, count, what);
  const contid::TautLimiter robot(self, axes, at, steps);
  if (robot.keeps(candidate)) return nb::make_tuple(command, flags);
  int all = 0;
  if (robot.tightened(candidate, next)) {
    all = kTension;
  } else {
    const bool refused = !std::all_of(to, to + count, [](double value) { return std::isfinite(value); });
    if (refused) all = contid::kRefused;
    for (int t = 0; t < count; ++t) {
      if (refused) to[t] = at[t];
      if (refused || !std::isfinite(paces[t])) paces[t] = 0.0;
    }
    robot.toward(to, paces, next);
  }
  int after[contid::kMostTendons];
  for (int t = 0; t < count; ++t) after[t] = static_cast<int>(bits[t]) | all | (next[t] != candidate[t] ? kTension : 0);
  return nb::make_tuple(contid::tuple_of(next, count), numbers_of(after, count));
}

nb::tuple lifted(const contid::TautPulls& self, nb::handle pulls, nb::handle upper, double width) {
  constexpr char what[] = "lifted: one number per tendon";
  contid::Pulls at, most, out;
  read(pulls, at, self.tendons, what), read(upper, most, self.tendons, what);
  self.lifted(at, most, width, out);
  return contid::tuple_of(out, self.tendons);
}

double greatest_excess(const contid::TautPulls& self, nb::handle pulls, nb::handle lower, nb::handle upper) {
  constexpr char what[] = "greatest_excess: one number per tendon";
  contid::Pulls at, least, most;
  double over[5 * contid::kMostTendons];
  read(pulls, at, self.tendons, what), read(lower, least, self.tendons, what), read(upper, most, self.tendons, what);
  self.excess(at, least, most, over);
  return *std::max_element(over, over + self.limits());
}

void pseudo_inverse(Grid matrix, double singular, Written out) {
  const int rows = static_cast<int>(matrix.shape(0)), columns = static_cast<int>(matrix.shape(1));
  if (std::max(rows, columns) > kMostColumns) throw nb::value_error("matrix: too large");
  if (out.ndim() != 2 || out.shape(0) != matrix.shape(1) || out.shape(1) != matrix.shape(0))
    throw nb::value_error("out: the shape of the transpose");
  const bool wide = columns > rows;
  contid::SmallMatrix a;
  a.rows = std::max(rows, columns), a.columns = std::min(rows, columns);
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) {
      const double value = matrix.data()[i * columns + j];
      if (!std::isfinite(value)) throw nb::value_error("matrix: all numbers must be finite");
      (wide ? a.of[i][j] : a.of[j][i]) = value;
    }
  contid::pseudo_inverse(a, wide, singular, out.data());
}

void nearest_step(Grid slopes, Row along, double size, Row asked, double pace, Row preferred, Row low, Row high,
                  Bounds held, Written out) {
  const std::size_t rows = slopes.shape(0), axes = slopes.shape(1);
  if (axes > kMostColumns || rows + 1 + axes > contid::kMostRows) throw nb::value_error("slopes: too large");
  if (along.shape(0) != rows || asked.shape(0) != rows || preferred.shape(0) != axes || low.shape(0) != axes ||
      high.shape(0) != axes || held.shape(0) != axes || out.ndim() != 1 || out.shape(0) != axes)
    throw nb::value_error("shapes that do not fit each other");
  const contid::Chord chord{static_cast<int>(rows), static_cast<int>(axes), slopes.data(), along.data(), size};
  contid::nearest_step(chord, asked.data(), pace, preferred.data(), low.data(), high.data(), held.data(), out.data());
  for (std::size_t j = 0; j < axes; ++j)
    if (!std::isfinite(out.data()[j])) throw nb::value_error("slopes: all numbers must be finite");
}

}  // namespace

namespace contid {
void bind_guard(nb::module_& module);
void bind_motion(nb::module_& module);
void bind_rows(nb::module_& module);
}  // namespace contid

NB_MODULE(KERNEL_MODULE, module) {
  module.doc() = "The limits of a tick, of axes, of taut tendons and along a chord, and motions within them.";
  module.def("brake_step", &contid::brake_step, nb::arg("room"), nb::arg("change"));
  module.def("stops_within", &contid::stops_within, nb::arg("room"), nb::arg("step"), nb::arg("change"));
  module.def("allowed_steps", &allowed_steps, nb::arg("limits"), nb::arg("last"), nb::arg("last_step"));
  module.def("limit_axis", &limit_axis, nb::arg("limits"), nb::arg("last"), nb::arg("last_step"), nb::arg("target"),
             nb::arg("target_step"));
  module.def("limit", &limit, nb::arg("limits"), nb::arg("last"), nb::arg("last_steps"), nb::arg("targets"),
             nb::arg("target_steps"));
  module.def("followed", &followed, nb::arg("limits"), nb::arg("last"), nb::arg("last_steps"), nb::arg("targets"));
  module.def("pseudo_inverse", &pseudo_inverse, nb::arg("matrix"), nb::arg("singular"), nb::arg("out"));
  module.def("nearest_step", &nearest_step, nb::arg("slopes"), nb::arg("along"), nb::arg("size"), nb::arg("asked"),
             nb::arg("pace"), nb::arg("preferred"), nb::arg("low"), nb::arg("high"), nb::arg("held"), nb::arg("out"));
  nb::class_<contid::TautPulls>(module, "TautPulls")
      .def("__init__", &make, nb::arg("demand"), nb::arg("pull_matrix"), nb::arg("bends_by_pulls"),
           nb::arg("variables_by_pulls"), nb::arg("slack_free"), nb::arg("rest"), nb::arg("stiffness"),
           nb::arg("section_of"), nb::arg("bend_max"), nb::arg("floor"), nb::arg("limit"))
      .def("limit", &limit_taut, nb::arg("limits"), nb::arg("last"), nb::arg("last_steps"), nb::arg("answer"),
           nb::arg("answer_steps"), nb::arg("command"), nb::arg("flags"))
      .def("lifted", &lifted, nb::arg("pulls"), nb::arg("upper"), nb::arg("width"))
      .def("greatest_excess", &greatest_excess, nb::arg("pulls"), nb::arg("lower"), nb::arg("upper"));
  contid::bind_guard(module);
  contid::bind_motion(module);
  contid::bind_rows(module);
}

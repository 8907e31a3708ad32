// States of the axes from which they can stop inside every limit: of velocity, of position, and shared.
//
// Limits that axes share are convex functions e of the axes, positive beyond the limit; those of a tendon robot are its
// tensions, travels and bends, which are convex in its pulls as well. contid/control/tick/jerk_guard.py uses this on
// live streams, by the rules of motions of contid/control/tick/config.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "axis_records.hpp"
#include "stop.hpp"

namespace contid {

// A bound counts as kept up to this share of it: rounding.
constexpr double kKept = 1.0 + 1e-6;
// Greatest slope of a shared limit along one axis, which SharedLimits of contid/control/tick/shared_limits.py promises.
constexpr double kSteepest = 2.0;
// Excess of a position that is rounding [m], and of a tension: LIMIT_TOLERANCE_M of contid/units.py.
constexpr double kRoundingM = 1e-12, kToleranceM = 1e-9;
// By motion rules before 3, an axis had at least this share of its greatest velocity in the estimate of its stop.
constexpr double kSlow = 0.05;
// States of a stop that are compared with shared limits, and where it comes close to their bounds: an axis that still
// accelerates leads beyond them early in its stop, and tensions have corners.
constexpr int kLookedAt = 4, kLookedAtClosely = 32;
// Share of the jerk that a stop uses: the pursuit that leads into it (contid/kernels/motion/pursuit.cpp) uses no more.
constexpr double kJerkShare = 1.0 - 1e-6;

// Way of a stop from a speed without acceleration: half the speed times its duration. The deceleration stays at
// `change` for a while, or returns to zero before it gets there.
inline double from_cruise(double speed, double change, double jolt) {
  const double ticks = speed * jolt >= change * change ? speed / change + change / jolt : 2.0 * std::sqrt(speed / jolt);
  return 0.5 * speed * ticks;
}

// How far an axis goes on that stops as soon as it can; speed and acceleration towards the limit, the former not
// negative, per tick.
inline double stop_length(double speed, double acceleration, double change, double jolt) {
  const double top = speed + 0.5 * acceleration * acceleration / jolt;
  if (acceleration >= 0.0) {  // its speed grows to `top` until its acceleration is zero
    const double until_top = speed * acceleration / jolt + std::pow(acceleration, 3.0) / (3.0 * jolt * jolt);
    return until_top + from_cruise(top, change, jolt);
  }
  // It decelerates as in a stop that began at the speed `top` without acceleration, `ticks` ago.
  const double ticks = -acceleration / jolt;
  // The deceleration of that stop, jolt ticks, grows to the smaller of `change` and sqrt(top jolt). One above
  // sqrt(top jolt) stops the axis before it can be brought to zero, so within `ticks` and never faster than `speed`.
  // By motion rules before 3, one above `change` by rounding got the same way, too short for an axis that is fast.
  if (ticks > std::min(change / jolt, std::sqrt(top / jolt))) return speed * ticks;
  // The way of the whole stop, less what it has covered in `ticks`.
  return std::max(0.0, from_cruise(top, change, jolt) - (top * ticks - jolt * std::pow(ticks, 3.0) / 6.0));
}

struct Guard {
  int axes, own;  // of them the model's
  double period_s;
  int motion_rules;
  std::vector<Axis> limits;
  std::vector<double> velocity, acceleration, jerk;

  double jolt(int k) const { return jerk[k] * period_s * period_s * period_s; }

  // Whether an axis can go on from a state within its velocity, and stop within its limits of position. Times are in
  // ticks, as in `Axis`.
  bool viable(int k, double at, double speed, double acceleration) const {
    const Axis& axis = limits[k];
    const double jolt = this->jolt(k);
    // The speed when the acceleration has been brought to zero at the full jerk.
    if (std::fabs(speed + 0.5 * acceleration * std::fabs(acceleration) / jolt) > axis.step * kKept) return false;
    double room = axis.upper - at;
    if (speed < 0.0) room = at - axis.lower, speed = -speed, acceleration = -acceleration;
    if (motion_rules > 2)  // a deceleration above its greatest is so by rounding
      acceleration = std::max(acceleration, -axis.change);
    // More than any stop needs: one from `top` without acceleration takes top / change + change / jolt ticks at most,
    // with half of `top` as its mean speed. An axis that accelerates gets to `top` in up to change / jolt ticks before
    // it: with half of those of the stop, 1.5. One tick is added. Motion rules before 2 left this acceleration out.
    double top = speed, jerk_phases = 1.0;
    if (motion_rules > 1 && acceleration > 0.0)
      top = speed + 0.5 * acceleration * acceleration / jolt, jerk_phases = 1.5;
    return room > top * (top / axis.change + jerk_phases * axis.change / jolt + 1.0) ||
           stop_length(speed, acceleration, axis.change, jolt) <= std::max(room, 0.0) + axis.change * 1e-6;
  }

  // Whether every axis may be on its answer in this tick, and on it if it goes on in the two next. `last_steps` are
  // those before `steps`, the last; `paces` and `last_paces` how far the answer moved in this tick and the one before.
  bool on_answer(const double* answer, const double* last, const double* steps, const double* last_steps,
                 const double* paces, const double* last_paces) const {
    for (int k = 0; k < axes; ++k) {
      const double top = limits[k].step * kKept, change = limits[k].change * kKept, most = jolt(k) * kKept;
      const double step = answer[k] - last[k], c1 = step - steps[k], bend = paces[k] - last_paces[k];
      const double c2 = paces[k] + bend - step;
      if (std::fabs(step) > top || std::fabs(c1) > change || std::fabs(c1 - (steps[k] - last_steps[k])) > most ||
          std::fabs(c2) > change || std::fabs(c2 - c1) > most || std::fabs(bend - c2) > most ||
          !viable(k, answer[k], step + 0.5 * c1, c1))
        return false;
    }
    return true;
  }

  bool all_viable(const Moving& at) const {
    for (int k = 0; k < axes; ++k)
      if (!viable(k, at.position[k], at.velocity[k] * period_s, at.acceleration[k] * period_s * period_s)) return false;
    return true;
  }

  // Whether axes that share limits can stop together inside them; `excess` is of the limit that is exceeded most. Where
  // the last command exceeds it, the axes may go on to do so as much.
  template <class Excess> bool stops_inside(const Moving& at, const double* last, bool taut, Excess excess) const {
    const double most = excess(at.position);
    if (!taut && -most > kSteepest * reach(at)) return true;
    const double allowed = std::max(excess(last), 0.0) + (taut ? kToleranceM : kRoundingM);
    if (most > allowed) return false;
    std::vector<AxisStop> stops(axes);
    AxisNumbers shares;
    const double duration_s = stop(at, shares, stops.data());
    // With a margin, the larger excess of two neighbouring states, plus their difference, does not exceed the limits
    // either: this stands in for the states between the two, which are not computed.
    const auto keeps = [&](int looked_at, bool with_margin) {
      std::vector<double> ways(looked_at * axes);
      for (int n = 0; n < looked_at; ++n)
        for (int k = 0; k < axes; ++k) {
          const double at_s = duration_s * (n + 1) / looked_at;
          ways[n * axes + k] = at.position[k] + shares[k] * stops[k].way(at_s) * velocity[k];
          const double beyond = std::max(std::min(limits[k].lower, last[k]) - ways[n * axes + k],
                                         ways[n * axes + k] - std::max(limits[k].upper, last[k]));
          if (!(beyond <= kRoundingM)) return false;
        }
      double before = most;
      for (int n = 0; n < looked_at; ++n) {
        const double here = excess(&ways[n * axes]);
        if (!((with_margin ? std::max(before, here) + std::fabs(here - before) : here) <= allowed)) return false;
        before = here;
      }
      return true;
    };
    if (!taut && motion_rules < 2) return keeps(kLookedAt, false);
    return keeps(kLookedAt, true) || keeps(kLookedAtClosely, false);
  }

 private:
  // More than the sum of the ways of the axes that stop together: they take as long as the slowest, each at its top
  // speed at most. Rules before 3 had an estimate, less than the way of an axis that is slow and accelerates.
  double reach(const Moving& at) const {
    double stop_s = 0.0, sum = 0.0;
    const auto top = [&](int k) {
      return std::fabs(at.velocity[k]) + 0.5 * at.acceleration[k] * at.acceleration[k] / jerk[k];
    };
    for (int k = 0; k < own; ++k) {
      const double v = std::fabs(at.velocity[k]), a = acceleration[k];
      if (motion_rules > 2)
        stop_s = std::max(stop_s, std::fabs(at.acceleration[k]) / jerk[k] + top(k) / a + a / jerk[k]);
      else
        sum += std::max(v, kSlow * velocity[k]) * (v / a + 2.0 * a / jerk[k]);
    }
    for (int k = 0; k < own && motion_rules > 2; ++k) sum += top(k) * stop_s;
    return sum;
  }

  // The stop of every axis, in units of its greatest velocity, and its duration [s]. Axes whose velocities and
  // accelerations are parallel stay on their straight line, by motion rules above 1: theirs are shares of one stop.
  double stop(const Moving& at, double* shares, AxisStop* stops) const {
    AxisNumbers v, a, most, jolts;
    int lead = 0;
    const auto rounded = [](double value) { return std::fabs(value) < kNone ? 0.0 : value; };
    for (int k = 0; k < axes; ++k) {
      v[k] = rounded(at.velocity[k] / velocity[k]), a[k] = rounded(at.acceleration[k] / velocity[k]);
      most[k] = acceleration[k] / velocity[k], jolts[k] = kJerkShare * (jerk[k] / velocity[k]), shares[k] = 1.0;
      if (std::fabs(v[k]) > std::fabs(v[lead])) lead = k;
    }
    bool line = motion_rules > 1 && v[lead] != 0.0;
    for (int k = 0; line && k < axes; ++k) {
      const double share = v[k] / v[lead];
      line = std::fabs(v[k] - share * v[lead]) <= kParallel && std::fabs(a[k] - share * a[lead]) <= kParallel * most[k];
    }
    if (line) {
      double greatest = most[lead], jolt = jolts[lead];
      for (int k = 0; k < axes; ++k) {
        shares[k] = v[k] / v[lead];
        if (shares[k] == 0.0) continue;
        greatest = std::min(greatest, most[k] / std::fabs(shares[k]));
        jolt = std::min(jolt, jolts[k] / std::fabs(shares[k]));
      }
      std::fill_n(stops, axes, shortest_stop(v[lead], a[lead], greatest, jolt));
      return stops[0].duration_s();
    }
    double duration_s = 0.0;
    for (int k = 0; k < axes; ++k) {
      stops[k] = shortest_stop(v[k], a[k], most[k], jolts[k]);
      duration_s = std::max(duration_s, stops[k].duration_s());
    }
    for (int k = 0; k < axes; ++k)
      if (stops[k].duration_s() < duration_s) stops[k] = stop_in(v[k], a[k], jolts[k], duration_s);
    return duration_s;
  }
};

}  // namespace contid

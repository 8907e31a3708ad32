// Trapezoidal profile and first-order response of a simulated device, both in closed form.
//
// The profile r(t) is the time-optimal motion to rest under |r'| <= v_max and |r''| <= a_max from any start position
// and velocity: at most four phases of constant acceleration. The device follows it as
//
//     tau x' = r - x
//
// whose solution over a phase r = r0 + v t + a t^2 / 2 is, with the particular part p(t) = r - tau r' + tau^2 r'',
//
//     x(t) = p(t) + (x(0) - p(0)) exp(-t / tau).
//
// So a long step equals many short ones up to rounding: simulated devices do not depend on the tick rate. Units are
// those of the device: rad or Pa, and their derivatives by s.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace contid {

struct ProfileState {
  double position, velocity;
};

// Constant acceleration from `start_s` until the next phase.
struct Phase {
  double start_s, position, velocity, acceleration;

  ProfileState at(double t_s) const {
    const double dt = t_s - start_s;
    return {position + dt * (velocity + 0.5 * dt * acceleration), velocity + dt * acceleration};
  }
};

struct Phases {
  std::array<Phase, 8> of;
  int count = 0;

  void add(const Phase& phase) { of[count++] = phase; }
  void drop_first() { std::copy(of.begin() + 1, of.begin() + count--, of.begin()); }
};

// A goal on a straight line: where it is now, its velocity, and when it stands, where it is now. The set-point of a
// motor board follows a stream in this way (firmware/contid_due/src/core/setpoint.h).
struct MovingGoal {
  double position, velocity, until_s;
};

// Share of the top speed that a moving goal has at most: the rest is for catching up with it.
constexpr double kGoalShare = 63.0 / 64.0;

// Adds the fastest motion to rest at `goal`; its last phase rests there. Either limit may be infinite: without `a_max`
// the speed jumps, without both the goal is reached at once.
inline void plan(double t_s, ProfileState from, double goal, double v_max, double a_max, Phases& out) {
  const double distance = goal - from.position;
  if (std::isinf(a_max)) {
    const double duration = std::isinf(v_max) ? 0.0 : std::fabs(distance) / v_max;
    if (duration != 0.0) out.add({t_s, from.position, std::copysign(v_max, distance), 0.0});
    return out.add({t_s + duration, goal, 0.0, 0.0});
  }
  // Seen in the direction in which braking now would still fall short of the goal.
  const double sign = distance >= from.velocity * std::fabs(from.velocity) / (2.0 * a_max) ? 1.0 : -1.0;
  const double length = sign * distance, speed = sign * from.velocity;
  const double top = std::min(v_max, std::sqrt(std::max(0.0, a_max * length + 0.5 * speed * speed)));
  const double ramp = std::copysign(a_max, top - speed);
  const double ramp_length = (top * top - speed * speed) / (2.0 * ramp);
  const double cruise_length = std::max(0.0, length - ramp_length - top * top / (2.0 * a_max));
  const double durations[3] = {std::fabs(top - speed) / a_max, top > 0.0 ? cruise_length / top : 0.0, top / a_max};
  const double accelerations[3] = {ramp, 0.0, -a_max};
  for (int k = 0; k < 3; ++k) {
    if (durations[k] <= 0.0) continue;
    const Phase phase{t_s, from.position, from.velocity, sign * accelerations[k]};
    out.add(phase);
    t_s += durations[k];
    from = phase.at(t_s);
  }
  out.add({t_s, goal, 0.0, 0.0});
}

// Adds the fastest motion that meets a moving goal, goes with it, and comes to rest once it stands. Seen from the goal
// it is a motion to rest, with what is left of the top speed in its direction.
inline void plan_to_moving(double t_s, ProfileState from, const MovingGoal& goal, double v_max, double a_max,
                           Phases& out) {
  const double drift = std::min(std::max(goal.velocity, -kGoalShare * v_max), kGoalShare * v_max);
  const double distance = goal.position - from.position, speed = from.velocity - drift;
  const bool ahead = distance >= speed * std::fabs(speed) / (2.0 * a_max);
  Phases seen;
  plan(t_s, {-distance, speed}, 0.0, ahead ? v_max - drift : v_max + drift, a_max, seen);
  for (int k = 0; k < seen.count; ++k) {
    const Phase& each = seen.of[k];
    if (each.start_s >= goal.until_s) continue;
    out.add({each.start_s, goal.position + drift * (each.start_s - t_s) + each.position, each.velocity + drift,
             each.acceleration});
  }
  if (out.count) from = out.of[out.count - 1].at(goal.until_s);
  plan(goal.until_s, from, goal.position, v_max, a_max, out);
}

// State of one simulated actuator: its profile and its own position.
struct ProfileMotion {
  double time_s, value, tau_s;
  bool blocked = false;  // the shaft is blocked: the profile continues, the value does not
  Phases phases;

  ProfileMotion(double time_s, double value, double tau_s) : time_s(time_s), value(value), tau_s(tau_s) { freeze(); }

  ProfileState reference() const { return phases.of[0].at(time_s); }

  // Velocity of the device itself.
  double velocity() const {
    if (blocked) return 0.0;
    const ProfileState now = reference();
    return tau_s > 0.0 ? (now.position - value) / tau_s : now.velocity;
  }

  // Go to a goal from the present state of the profile, without a jump of its velocity.
  void go(double goal, double v_max, double a_max) {
    const ProfileState now = reference();
    phases.count = 0, plan(time_s, now, goal, v_max, a_max, phases);
  }

  void go_with(const MovingGoal& goal, double v_max, double a_max) {
    const ProfileState now = reference();
    phases.count = 0, plan_to_moving(time_s, now, goal, v_max, a_max, phases);
  }

  // End the profile where it is; the value follows with its response.
  void stop() {
    const double position = reference().position;
    phases.count = 0, phases.add({time_s, position, 0.0, 0.0});
  }

  // Stop at the present value.
  void freeze() { phases.count = 0, phases.add({time_s, value, 0.0, 0.0}); }

  // Advance to a later time; an earlier one changes nothing.
  void advance(double to_s) {
    while (time_s < to_s) {
      drop_past();
      const Phase phase = phases.of[0];
      const double end_s = phases.count > 1 ? std::min(to_s, phases.of[1].start_s) : to_s;
      if (!blocked) value = response(phase, end_s);
      time_s = end_s;
    }
    drop_past();
  }

 private:
  void drop_past() {
    while (phases.count > 1 && phases.of[1].start_s <= time_s) phases.drop_first();
  }

  // The value at the end of a part of a phase.
  double response(const Phase& phase, double end_s) const {
    const ProfileState after = phase.at(end_s), now = phase.at(time_s);
    if (tau_s <= 0.0) return after.position;
    const double bend = tau_s * tau_s * phase.acceleration;
    const double decay = std::exp(-(end_s - time_s) / tau_s);
    return after.position - tau_s * after.velocity + bend +
           (value - (now.position - tau_s * now.velocity + bend)) * decay;
  }
};

}  // namespace contid

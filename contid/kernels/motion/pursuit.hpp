// Jerk-limited motion of several axes to a goal that moves: the state after a time, from any state.
//
// The motion is that of ruckig in the frame that moves with the goal at its present velocity, where the goal rests:
// time-optimal, with every axis there at the same instant. Velocity limits are shifted by the velocity of the frame;
// acceleration and jerk are the same in both. Every axis has its velocity limit as unit: positions are in seconds,
// velocities are shares of it.
//
// Axes whose present rates already lead to the goal, or that stop from such, stay on the straight line to it: the
// motion of one axis, with the limits that bind first, is theirs by shares. Ruckig itself finds that only where the
// rates are parallel to the last bit.
//
// Source: L. Berscheid, T. Kroeger, "Jerk-limited Real-time Trajectory Generation with Arbitrary Target States",
// RSS 2021 (the ruckig library).
#pragma once

#include "../limiter/axis_numbers.hpp"

namespace contid {

// Straight lines of axes whose present rates allow them, by versions of the rules of motions. kRounded leads past the
// goal of an axis whose distance to it is rounded to zero, by at most what its greatest velocity makes in kNegligible
// seconds. To a goal on a limit that axes share such a line led 3e-12 m beyond the limit. kExact leads to the goal, and
// rounds no distance of an axis in motion to zero, which was a step of up to 2e-4 Pa.
enum class Lines { kNone = 0, kRounded = 1, kExact = 2 };

// Greatest velocity, acceleration and jerk of every axis [m, Pa or rad, per s, s^2 and s^3].
struct AxisRates {
  int axes;
  const double *velocity, *acceleration, *jerk;
};

// Velocity of the frame of a goal that moves by a pace; 0 where an axis has jumped.
void frame_velocity(const double* pace, const AxisRates& rates, double* frame);

// Each finds the state after `time_s`, false where ruckig finds no motion. `goal`: where it will be after `time_s`, if
// it goes on; `frame`: its velocity; `together`: every axis arrives at the same instant, else each as early as it can.
bool pursued(const Moving& state, const double* goal, const double* frame, const AxisRates& rates, double time_s,
             bool together, Lines lines, Moving& after);

// On the straight line of the present motion, to its point nearest to a goal; false where the axes are not on a line.
bool kept_line(const Moving& state, const double* goal, const AxisRates& rates, double time_s, Lines lines,
               Moving& after);

// Of the shortest stop.
bool braked(const Moving& state, const AxisRates& rates, double time_s, bool together, Lines lines, Moving& after);

}  // namespace contid

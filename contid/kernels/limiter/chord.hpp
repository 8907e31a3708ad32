// The step of all axes that leaves a straight line least: contid/control/tick/ways/chord.py.
#pragma once

#include "small_matrices.hpp"

namespace contid {

// Weights w of progress against motion across the line, and v, per size of the slopes, of the preferred steps.
constexpr double kProgress = 1e-3;
constexpr double kPreference = 1e-6;

// A straight line in the coordinates of a target, one row for each; axes in units of their greatest step.
struct Chord {
  int rows, axes;
  const double* slopes;  // derivative of the coordinates by the axes, (rows, axes)
  const double* along;   // direction of the line, of length 1
  double size;           // root of the sum of the squares of the slopes
};

// minimise  |across (J d - asked)|^2 + w^2 (along (J d - asked) - pace)^2 + v^2 |d - preferred|^2
//
// with low <= d <= high: J are the slopes, d is the step of the axes. `asked`, a number for each row, is the drift of
// the goal less what the linear model misses; `pace` is how far to go along the line beyond it. The others have a
// number for each axis; `held` is as for bounded_least_squares.
inline void nearest_step(const Chord& chord, const double* asked, double pace, const double* preferred,
                         const double* low, const double* high, signed char* held, double* step) {
  SmallMatrix a;
  double right[kMostRows];
  const int rows = a.rows = chord.rows + 1 + chord.axes;
  a.columns = chord.axes;
  const double progress = dot(chord.along, asked, chord.rows), preference = kPreference * chord.size;
  for (int j = 0; j < chord.axes; ++j) {
    double* column = a.of[j];
    std::fill_n(column, rows, 0.0);
    double rate = 0.0;
    for (int i = 0; i < chord.rows; ++i) rate += chord.along[i] * chord.slopes[i * chord.axes + j];
    for (int i = 0; i < chord.rows; ++i) column[i] = chord.slopes[i * chord.axes + j] - chord.along[i] * rate;
    column[chord.rows] = kProgress * rate;
    column[chord.rows + 1 + j] = preference;
    right[chord.rows + 1 + j] = preference * preferred[j];
  }
  for (int i = 0; i < chord.rows; ++i) right[i] = asked[i] - chord.along[i] * progress;
  right[chord.rows] = kProgress * (pace + progress);
  bounded_least_squares(a, right, low, high, held, step);
}

}  // namespace contid

// Task of a rod, its error for a sweep, and the derivative of that error. Rows are lengths [mm]; a direction or a frame
// enters times `Task::length`.
#pragma once

#include "rod.hpp"

namespace contid {

struct Task {
  Vec tip, mid, direction;
  bool has_mid, has_direction, full_rotation;
  double length;
  Mat frame;  // twist-free frame of `direction`, for full_rotation
  int rows() const { return 3 + (has_mid ? 3 : 0) + (has_direction ? 3 : 0); }
  int independent() const { return 3 + (has_mid ? 3 : 0) + (has_direction ? (full_rotation ? 3 : 2) : 0); }
};

// Rotation that takes e3 to d the short way.
inline Mat tilt(Vec d) {
  if (d.z < -1.0 + 1e-12) return {{{1, 0, 0}, {0, -1, 0}, {0, 0, -1}}};
  const double c = 1.0 / (1.0 + d.z);
  return {{{1.0 - c * d.x * d.x, -c * d.x * d.y, d.x}, {-c * d.x * d.y, 1.0 - c * d.y * d.y, d.y}, {-d.x, -d.y, d.z}}};
}

// Quaternion (w >= 0, vector) of the rotation from the target to the found frame.
inline double half_turn(const Task& task, const Mat& R, Vec& vector) {
  Mat q{};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k) q.m[i][j] += R.m[i][k] * task.frame.m[j][k];
  const double w = 0.5 * std::sqrt(std::fmax(0.0, 1.0 + q.m[0][0] + q.m[1][1] + q.m[2][2]));
  const double s = 1.0 / (4.0 * std::fmax(w, 1e-9));
  vector = {s * (q.m[2][1] - q.m[1][2]), s * (q.m[0][2] - q.m[2][0]), s * (q.m[1][0] - q.m[0][1])};
  return w;
}

inline void put(double* r, Vec a) { r[0] = a.x, r[1] = a.y, r[2] = a.z; }

// r = (p - p*, m - m*, length (t - t*)), or length 2 vec(q) of the whole frame.
inline void residual(const Task& task, const Ends& s, double* r) {
  put(r, s.p - task.tip);
  r += 3;
  if (task.has_mid) put(r, s.mid - task.mid), r += 3;
  if (task.has_direction) {
    if (task.full_rotation) {
      Vec vector;
      half_turn(task, s.R, vector);
      put(r, 2.0 * task.length * vector);
    } else {
      put(r, task.length * (column(s.R, 2) - task.direction));
    }
  }
}

// Length of the residual.
inline double task_error(const Task& task, const Ends& s) {
  double r[9], sum = 0.0;
  residual(task, s, r);
  for (int a = 0; a < task.rows(); ++a) sum += r[a] * r[a];
  return std::sqrt(sum);
}

// Derivative of the residual by (base moment, pressures), the columns of the sweep.
inline void jacobian(const Task& task, const Sweep& s, int columns, double (&J)[9][kMostColumns]) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < columns; ++j) J[i][j] = s.tip.by.shift[i][j];
  int row = 3;
  if (task.has_mid) {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < columns; ++j) J[row + i][j] = s.mid_shift[i][j];
    row += 3;
  }
  if (task.has_direction) {
    Mat by_turn;
    if (task.full_rotation) {
      Vec vector;
      const double w = half_turn(task, s.tip.R, vector);
      by_turn = hat(-1.0 * vector);
      for (int i = 0; i < 3; ++i) by_turn.m[i][i] += w;
    } else {
      by_turn = hat(-1.0 * column(s.tip.R, 2));
    }
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < columns; ++j)
        J[row + i][j] = task.length * (by_turn.m[i][0] * s.tip.by.turn[0][j] + by_turn.m[i][1] * s.tip.by.turn[1][j] +
                                       by_turn.m[i][2] * s.tip.by.turn[2][j]);
  }
}

}  // namespace contid

// The quadratic programme of a bounded step, with loops of constant length for arms of one and two sections.
#include "box_step.hpp"

#include <cmath>

namespace contid {

namespace {

void factorise(const double (&H)[kMost][kMost], const int* rows, int count, FreeFactor& f) {
  if (count == f.free && std::equal(rows, rows + count, f.index)) return;
  f.free = count;
  std::copy(rows, rows + count, f.index);
  const int* index = f.index;
  for (int a = 0; a < count; ++a) {
    double diagonal = H[index[a]][index[a]];
    for (int k = 0; k < a; ++k) diagonal -= f.L[a][k] * f.L[a][k];
    f.L[a][a] = std::sqrt(std::fmax(diagonal, 1e-30));
    f.inverse[a] = 1.0 / f.L[a][a];
    for (int b = a + 1; b < count; ++b) {
      double value = H[index[b]][index[a]];
      for (int k = 0; k < a; ++k) value -= f.L[b][k] * f.L[a][k];
      f.L[b][a] = value * f.inverse[a];
    }
  }
}

void solve(const FreeFactor& f, double* x) {
  const int free = f.free;
  for (int a = 0; a < free; ++a) {
    for (int k = 0; k < a; ++k) x[a] -= f.L[a][k] * x[k];
    x[a] *= f.inverse[a];
  }
  for (int a = free - 1; a >= 0; --a) {
    for (int k = a + 1; k < free; ++k) x[a] -= f.L[k][a] * x[k];
    x[a] *= f.inverse[a];
  }
}
// `Size` is an int, or the number of unknowns as a constant.
template <class Size>
void minimise(Size n, const double (&H)[kMost][kMost], const double* g, const double* low, const double* high,
              double* d, FreeFactor& factor) {
  bool held[kMost];
  double largest = 0.0;
  for (int i = 0; i < n; ++i) {
    d[i] = 0.0;
    held[i] = (low[i] >= 0.0 && g[i] > 0.0) || (high[i] <= 0.0 && g[i] < 0.0);
    largest = std::fmax(largest, std::fabs(g[i]));
  }
  for (int round = 0; round < 4 * n + 4; ++round) {
    int index[kMost], free = 0;
    for (int i = 0; i < n; ++i)
      if (!held[i]) index[free++] = i;
    if (free > 0) {
      double x[kMost];
      for (int a = 0; a < free; ++a) {
        double slope = g[index[a]];
        for (int j = 0; j < n; ++j) slope += H[index[a]][j] * d[j];
        x[a] = -slope;
      }
      factorise(H, index, free, factor);
      solve(factor, x);
      double fraction = 1.0;
      int blocking = -1;
      for (int a = 0; a < free; ++a) {
        const int i = index[a];
        if (x[a] == 0.0) continue;
        const double room = ((x[a] > 0.0 ? high[i] : low[i]) - d[i]) / x[a];
        if (room < fraction) fraction = room, blocking = a;
      }
      for (int a = 0; a < free; ++a) d[index[a]] += fraction * x[a];
      if (blocking >= 0) {
        const int i = index[blocking];
        d[i] = x[blocking] > 0.0 ? high[i] : low[i];
        held[i] = true;
        continue;
      }
    }
    int worst = -1;
    double most = 1e-12 * (1.0 + largest);
    for (int i = 0; i < n; ++i) {
      if (!held[i]) continue;
      double pull = g[i];
      for (int j = 0; j < n; ++j) pull += H[i][j] * d[j];
      const double wrong = d[i] <= low[i] ? -pull : pull;
      if (wrong > most) most = wrong, worst = i;
    }
    if (worst < 0) break;
    held[worst] = false;
  }
  for (int i = 0; i < n; ++i) d[i] = std::min(std::max(d[i], low[i]), high[i]);
}

}  // namespace

void box_step(int n, const double (&H)[kMost][kMost], const double* g, const double* low, const double* high, double* d,
              FreeFactor& factor) {
  if (n == 3) return minimise(std::integral_constant<int, 3>(), H, g, low, high, d, factor);
  if (n == 6) return minimise(std::integral_constant<int, 6>(), H, g, low, high, d, factor);
  minimise(n, H, g, low, high, d, factor);
}

}  // namespace contid

// Statics of a tendon robot's backbone as a rod: chain of elements of constant strain, equilibrium by virtual work.
// extras/tendons/contid_tendons/rod.py states the equations. solve() does not allocate.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "element.hpp"

namespace contid {

constexpr int kSteps = 60;
constexpr double kExactRod = 1e-11;   // moments left over, as a share of the largest stiffness times a radian
constexpr double kLargestTurn = 0.3;  // of an element in one step [rad], and of its stretch

struct RodSetup {
  int elements = 0, tendons = 0;
  bool stretches = false;
  double base = 0.0;
  Vec offset{};
  std::vector<double> h, rigid, stiffness;  // of elements; stiffness has four numbers each
  std::vector<double> arms;                 // elements x tendons x 2; NaN where a tendon does not pass
  std::vector<double> tendon, rest;         // N/m and N of each tendon
  std::vector<Vec> weight;                  // of each element [N]
};

class TendonRodSolver {
 public:
  explicit TendonRodSolver(const RodSetup& setup);

  struct State {
    std::vector<double> x;                  // strain: bends u, v, twist, stretch of each element
    std::vector<double> left, matrix;       // moments left over [N m], 0 in equilibrium; their derivative by the strain
    std::vector<double> tension, by_pull;   // of the tendons [N]; derivative of `left` by their pulls
    std::vector<Vec> points, axes, shifts;  // ends of the elements [m]; twists of the coordinates about the base
    std::vector<Mat> frames;                // at the points
    Vec tip{};
    double size = 0.0;  // norm of `left`
  };

  const RodSetup& setup() const { return s_; }

  // The equilibrium, null when none was found.
  const State* solve(const double* pulls, Vec force, const double* start);

  // True where an equilibrium is a minimum of energy: no buckled pose is lower next to it.
  bool stable(const State& at);

  // Derivatives of the tip: 3 x tendons by the pulls, 3 x 3 by a force on it; false for a singular equilibrium.
  bool derivatives(const State& at, double* jacobian, double* compliance);

 private:
  const RodSetup s_;
  const int free_, size_;
  double scale_ = 0.0;
  State states_[2];
  std::vector<LocalElement> elements_;
  std::vector<Vec> forces_, moments_, moved_;
  std::vector<Mat> outer_;
  std::vector<double> dl_, root_, ratio_, factor_, right_;
  std::vector<int> order_;

  // Virtual work of a strain and its derivative.
  void balance(State& at, const double* pulls, Vec force);

  // Wrench of everything beyond each element, about the base; `outer` is the sum of point x load.
  void loads(const State& at, Vec force);

  void tendons(State& at, const double* pulls);

  // Tensions times second derivatives of the tendons' lengths in their element, and the stiffness of the backbone.
  void own_tendons(State& at, int e);

  // Loads that turn with the chain: the axis of an element turns what those beyond it move.
  void geometric(State& at);

  double& entry(State& at, int e, int k, int f, int l) { return at.matrix[(free_ * e + k) * size_ + free_ * f + l]; }

  // LU with pivots.
  bool factorise(const State& at);

  void solve_factored(double* right, int columns) const;
};

}  // namespace contid

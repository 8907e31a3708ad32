#include "solver.hpp"

#include <ruckig/ruckig.hpp>

namespace contid {

struct MotionSolver::Ruckig {
  explicit Ruckig(int axes) : solver(axes), input(axes), motion(axes) {}
  ruckig::Ruckig<ruckig::DynamicDOFs> solver;
  ruckig::InputParameter<ruckig::DynamicDOFs> input;
  ruckig::Trajectory<ruckig::DynamicDOFs> motion;
};

MotionSolver::MotionSolver(int axes) : ruckig_(std::make_unique<Ruckig>(axes)) {
  for (auto* each : {&asked_.position, &asked_.velocity, &asked_.acceleration, &asked_.goal, &asked_.low, &asked_.top,
                     &asked_.most, &asked_.jerk, &at_.position, &at_.velocity, &at_.acceleration})
    each->resize(axes);
}

MotionSolver::~MotionSolver() = default;

MotionSolver& MotionSolver::of(int axes) {
  thread_local std::vector<std::unique_ptr<MotionSolver>> kept;
  if (static_cast<int>(kept.size()) <= axes) kept.resize(axes + 1);
  if (!kept[axes]) kept[axes] = std::make_unique<MotionSolver>(axes);
  return *kept[axes];
}

void MotionSolver::fill(Control control, Arrival arrival, double jerk_share) {
  auto& input = ruckig_->input;
  input.control_interface =
      control == Control::kPosition ? ruckig::ControlInterface::Position : ruckig::ControlInterface::Velocity;
  input.synchronization = arrival == Arrival::kEach       ? ruckig::Synchronization::None
                          : arrival == Arrival::kTogether ? ruckig::Synchronization::Time
                                                          : ruckig::Synchronization::Phase;
  input.current_position = asked_.position, input.current_velocity = asked_.velocity;
  input.current_acceleration = asked_.acceleration, input.target_position = asked_.goal;
  input.min_velocity = asked_.low, input.max_velocity = asked_.top, input.max_acceleration = asked_.most;
  for (std::size_t k = 0; k < asked_.jerk.size(); ++k) input.max_jerk[k] = jerk_share * asked_.jerk[k];
}

bool MotionSolver::solve(Control control, Arrival arrival, double jerk_share) {
  fill(control, arrival, jerk_share);
  const ruckig::Result result = ruckig_->solver.calculate(ruckig_->input, ruckig_->motion);
  return result == ruckig::Result::Working || result == ruckig::Result::Finished;
}

std::string MotionSolver::reason(Control control, Arrival arrival, double jerk_share) {
  if (solve(control, arrival, jerk_share)) return "";
  try {
    ruckig_->solver.validate_input(ruckig_->input, false, true);
  } catch (const ruckig::RuckigError& error) {
    return error.what();
  }
  const ruckig::Result result = ruckig_->solver.calculate(ruckig_->input, ruckig_->motion);
  return result == ruckig::Result::ErrorTrajectoryDuration ? "it would take more than two hours"
                                                           : "ruckig finds none within the limits";
}

double MotionSolver::duration_s() const { return ruckig_->motion.get_duration(); }

double MotionSolver::start() const { return at(0.0).position[0]; }

const ScaledState& MotionSolver::at(double time_s) const {
  ruckig_->motion.at_time(time_s, at_.position, at_.velocity, at_.acceleration);
  return at_;
}

}  // namespace contid

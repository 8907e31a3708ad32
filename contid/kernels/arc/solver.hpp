// A chain of sections as the bindings see it: behind it stands a build for any number of sections, or for exactly one.
// Its interface in Python: contid/kinematics/arc/solver.py. Units: m.
//
// The variables of a section are three lengths of tubes or racks (ArcSetup), or two bends times the length of its
// backbone (TendonSetup). The mid-point is the end of the first section, its link included.
#pragma once

#include <memory>
#include <vector>

#include "../batch.hpp"
#include "../clearance/obstacle.hpp"

namespace contid {

constexpr int kMostSections = 8, kMostVariables = 3 * kMostSections;
// Planes of eight sections of eight tendons: one least pull, eight largest pulls and seven tensions of each tendon.
constexpr int kMostPlanes = 1024;

// Parameters of the solver, in the order of Tuning of contid/kinematics/arc/solver.py, which has their meaning.
struct Tuning {
  double ell, tolerance, home_tolerance, weight, near;
  int home_steps;
  double contraction;
  double slow;
  int iterations, settling, starts, agreeing;
  double tracking, still, still_error;
};

// What is asked for; rows of numbers in the base frame.
struct Goal {
  const double* tip;
  const double* direction;           // unit tangent at the tip; may be null
  const double* mid;                 // mid-point; may be null
  const double* rotation = nullptr;  // of the tip frame, row-major; instead of a direction
  bool follows = false;              // an answer out of reach that is stationary next to the seed ends the search
};

struct Answer {
  static constexpr int kWords = (kMostPlanes + kMostSections + 63) / 64;  // a bit for each plane and for each cone
  double lengths[kMostVariables];                                         // the variables
  double residual;                                                        // distance of the tip from the goal
  bool converged;                                                         // the goal is met within the tolerance
  std::uint64_t binding[kWords];                                          // limits that bind, a bit for each
  int iterations;                                                         // steps of all starts
  int starts;                                                             // starts that were tried
};

// Where a chain ends.
struct Frames {
  double tip[3];
  double rotation[9];  // tip to base, row-major
  double mid[3];
};

// What redundant axes keep away from.
struct Surroundings {
  std::vector<Obstacle> obstacles;  // in the base frame
  double radius = 0.0;              // of the body
  double margin = 0.0;              // least distance of surfaces
  double from = 0.0;                // arc length where the body begins
  double zone = 0.0;                // the potential begins this far outside the margin
  double force = 0.0;               // its scale
};

class ChainSolver {
 public:
  virtual ~ChainSolver() = default;

  // Number of variables: lengths, or bends of tendon robots.
  virtual int size() const = 0;
  virtual void forward(const double* variables, Frames& out) const = 0;
  // 3 x size() each, row-major: derivatives of the tip, of the turn of its frame (a rotation vector in the base frame)
  // and of the mid-point.
  virtual void differentiate(const double* variables, double* tip, double* spin, double* mid) const = 0;
  // No obstacles switch it off.
  virtual void avoid(const Surroundings& around) = 0;
  virtual void solve(const Goal& goal, const double* seed, Answer& out) const = 0;

  virtual void forward_rows(const double* variables, std::size_t rows, int threads, std::uint8_t* out) const = 0;
  // `seeds`: one row for each target, or with `chained` the start of the first; then one thread does all rows.
  virtual void inverse_rows(const TargetRows& targets, std::size_t rows, const double* seeds, bool chained, int threads,
                            std::uint8_t* out) const = 0;
};

// Tubes and racks: three lengths per section.
struct ArcSetup {
  int count;                                                      // sections
  double radius[kMostSections], rigid[kMostSections];             // of the tubes' circle; length of the link behind it
  double to_arc[kMostSections][9], to_lengths[kMostSections][9];  // (l1, l2, l3) -> (u, v, L), and back; row-major
  double lower[kMostSections], upper[kMostSections], home[kMostVariables];
  double rack, curvature_max;  // greatest sum of one rack's lengths, and curvature [1/m]; infinite for none
  Tuning tuning;
};

// Bends of tendon robots: two per section, within planes.
struct TendonSetup {
  int count;                                             // sections
  double backbone[kMostSections], rigid[kMostSections];  // lengths of the backbone, and of the link behind it
  double bend_max[kMostSections], offset[2];             // [rad]; of the tip, across its tangent
  std::vector<double> normals, offsets;                  // planes: normal . variables <= offset
  Tuning tuning;
};

// The builds, each in a namespace of its own, to which CMakeLists.txt gives the name `section_build`. Those for an
// exact number of sections are null in a module that is linked without them.
namespace any_sections {
std::unique_ptr<ChainSolver> make_arc_solver(const ArcSetup&);
std::unique_ptr<ChainSolver> make_tendon_solver(const TendonSetup&);
}  // namespace any_sections
namespace one_section {
[[gnu::weak]] std::unique_ptr<ChainSolver> make_arc_solver(const ArcSetup&);
}
namespace two_sections {
[[gnu::weak]] std::unique_ptr<ChainSolver> make_arc_solver(const ArcSetup&);
}
namespace three_sections {
[[gnu::weak]] std::unique_ptr<ChainSolver> make_tendon_solver(const TendonSetup&);
}

}  // namespace contid

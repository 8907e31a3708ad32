// Motion of a rod in its strains q: a variational integrator with forces at the middle of each step.
//
// The discrete Lagrangian of a step of time h is the energy of the masses on their chords, less the energy of the
// strains half-way (J. E. Marsden and M. West, "Discrete mechanics and variational integrators", Acta Numerica 10,
// 2001):
//
//     L(q, r) = sum m |p(r) - p(q)|^2 / (2 h) - h U((q + r) / 2),
//
// where p are the bodies of chain.hpp. With the momentum y = J(q)^T m p', the damping D of Kelvin and Voigt and loads f
// at the beginning of the step, r and the next momentum are the answers of
//
//     J(q)^T m (p(r) - p(q)) / h + h/2 U'((q + r) / 2) + D (r - q) / 2 = y + h J(q)^T f
//     y_next = J(r)^T m (p(r) - p(q)) / h - h/2 U'((q + r) / 2) - D (r - q) / 2.
//
// It is symplectic, of second order, stable for stiff strains, and rests where U' = J^T f: in the equilibrium of the
// statics. U has the stiffness of the backbone, the moments of chambers (tau) and tendons as springs that only pull.
// The first equation is solved by Newton's method with the matrix M(q) / h + h/4 U'' + D/2 of the step's beginning,
// whose U'' is renewed where tendons begin to pull in another way. A tendon is damped by the rate at which it is
// stretched, that of its pull less that of its way along the body: one that is wound in as fast as the body bends has
// no damping. It is at most the tension of the spring. Pulls change linearly in a step.
//
// Loads act for half a step at its beginning and at its end, so that the momentum is that of the time of q.
// Twist and stretch of thin rods ring at 10^4 Hz, far above what a step resolves, and with almost no inertia their
// momenta would alternate from step to step without end. Their rates get an inertia of their own, h^2 / 4 times the
// stiffness: no such wave is faster than 2 / h, slow motion changes by the square of (frequency x h / 2), and energy is
// kept.
#pragma once

#include <vector>

#include "chain.hpp"

namespace contid {

constexpr double kSlow = 0.25;  // inertia of the rates of twist and stretch, in stiffness times the square of the step

struct MotionSetup {
  int elements = 0, tendons = 0;
  int strains = 3;                         // of an element: 3, 4 with stretch, 6 with shear
  std::vector<double> lengths, rigid;      // of elements [m]
  std::vector<Inertia> middles, ends;      // of elements [kg, kg m^2]
  std::vector<double> arms, tendon, rest;  // as in tendon/rod.hpp
  double base = 0.0;                       // length before the first element [m]
};

// Loads that do not depend on the strains during a step.
struct MotionLoads {
  Vec gravity{0, 0, 0};                // acceleration [m/s^2]
  std::vector<Wrench6> nodes;          // dead force and moment on the end of each element [N, N m]
  std::vector<double> strains, pulls;  // tau: elements x 6 [N m, N]; pulls of the tendons [m]
  double reached_in_s = 0.0;           // time in which the tendons are pulled so far, at least one step
};

// How a tendon pulls: with its spring and its damping, twice or not at all where damping has reached its limit.
enum class Pull : unsigned char { SLACK, DAMPED, DOUBLED, EASED };

class RodMotion {
 public:
  explicit RodMotion(MotionSetup setup);

  const MotionSetup& setup() const { return s_; }
  MotionLoads loads;
  std::vector<double> stiffness;  // of the strains, elements x 6 [N m, N]
  double damping_s = 0.0;         // damping is that times the stiffness of strains and tendons

  // The state: strains (elements x 6) and the momenta of the free ones.
  std::vector<double> strain, momentum;
  const Placed& placed() const { return now_; }
  std::vector<double> tensions;  // of the last evaluation of the strains' energy [N]

  // Take other strains at rest.
  void put(const double* strains);

  // One step of `h` seconds; halved, up to 2^6 parts, where Newton's method needs more. False: none was found.
  bool step(double h);

  // The equilibrium under the loads from the present strains; false: none was found, and nothing has changed.
  bool settle();

  // Of the state [J]: energy of the motion, and of strains, gravity and loads on nodes together.
  double kinetic();
  double potential();

  // Mass matrix and derivative of the balance at the present strains, free x free.
  void linearise(double* mass, double* stiffness);

  int free() const { return size_; }

 private:
  const MotionSetup s_;
  const int per_, size_;
  Placed now_, next_;
  std::vector<double> last_, trial_, middle_, right_, force_, matrix_, mass_, base_;
  std::vector<double> dl_, weights_;
  std::vector<double> held_, pull_, pull_rate_;  // pulls at the beginning of a step and where they act; their rate
  bool fresh_ = true;                            // no step yet since the strains were put
  std::vector<Pull> pulls_, assumed_;            // of the tendons, now and in the matrix

  int index(int e, int k) const { return per_ * e + k; }
  // Inertia of the rate of a strain over h: twist and stretch only.
  double slow(int e, int k, double h) const { return k < 2 ? 0.0 : kSlow * h * stiffness[kMaxStrains * e + k]; }
  void hold_pulls() { pull_ = held_ = loads.pulls, fresh_ = false; }
  bool advance(double h, int depth);
  bool solve(double h);

  // Derivative of the balance by the free strains, by central differences.
  void differentiate(double* stiffness);

  // J(q)^T of momenta of the motion from `from` to `to`, at the places `at`.
  void moved(const Placed& at, const Placed& from, const Placed& to, double scale, double* out);
  void external(const Placed& at, double* out);
  void gradient(const double* strains, double* out);
  void damp_tendons(double h);
  void add_curvature(const double* strains, double h, double* matrix);
  void mass(const Placed& at, double scale, double* matrix);
  void spread(const double* free, double share, double* strains) const;
};

}  // namespace contid

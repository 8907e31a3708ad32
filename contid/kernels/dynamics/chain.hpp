// A clamped chain of elements of constant strain in motion: where its mass is, and how it moves with the strains.
//
// The strain of an element of length h is a turn w = (-v, u, t) [rad], that is bends u, v and twist t, a stretch e and
// shears a, b; its end is exp(w, (a, b, 1 + e) h) of its start. Half of an element is the same with half the strain, so
// one exponential gives the middle and, composed with itself, the end. A rigid piece may follow. Rods without shear
// have the first four strains or, where they keep their length, three.
//
// Mass is at the middles and ends of elements by Simpson's rule, 1/6, 4/6, 1/6. A cross-section turns as two masses at
// the ends of its directors d1, d2 do: with the second moment j for each, j (|d1'|^2 + |d2'|^2) / 2 is the energy of a
// disc that has j across and 2 j about its axis.
#pragma once

#include <vector>

#include "../cosserat/spatial.hpp"

namespace contid {

constexpr int kMaxStrains = 6;

// Twists of a coordinate about the base: a point p that the coordinate carries moves by axis x p + shift.
struct Twist {
  Vec axis, shift;
};

// A point with mass: position, directors of its cross-section.
struct Body {
  Vec at, d1, d2;
};

inline Body operator-(const Body& a, const Body& b) { return {a.at - b.at, a.d1 - b.d1, a.d2 - b.d2}; }

// Force and moment about the base of weighted vectors on bodies: the transpose of a twist.
struct Wrench6 {
  Vec force{0, 0, 0}, moment{0, 0, 0};
};

inline double work(const Twist& t, const Wrench6& w) { return dot(t.axis, w.moment) + dot(t.shift, w.force); }

inline void add(Wrench6& sum, const Wrench6& w) { sum.force = sum.force + w.force, sum.moment = sum.moment + w.moment; }

// Mass and second moment of a body; the wrench of m * motion at its place.
struct Inertia {
  double mass = 0.0, second = 0.0;
};

inline Wrench6 momentum(const Inertia& i, const Body& place, const Body& motion) {
  return {i.mass * motion.at,
          i.mass * cross(place.at, motion.at) + i.second * (cross(place.d1, motion.d1) + cross(place.d2, motion.d2))};
}

// Sum over bodies that move together with a twist: what momentum() gives for the motion by the twist.
struct Together {
  double mass = 0.0;
  Vec first{0, 0, 0};  // sum of mass * position
  double m[6] = {};    // sum of mass (|x|^2 - x x^T) + second (2 - d1 d1^T - d2 d2^T): xx, yy, zz, xy, xz, yz

  void add(const Inertia& i, const Body& b) {
    mass += i.mass;
    first = first + i.mass * b.at;
    const auto one = [&](double w, Vec x) {
      m[0] += w * (x.y * x.y + x.z * x.z), m[1] += w * (x.x * x.x + x.z * x.z), m[2] += w * (x.x * x.x + x.y * x.y);
      m[3] -= w * x.x * x.y, m[4] -= w * x.x * x.z, m[5] -= w * x.y * x.z;
    };
    one(i.mass, b.at), one(i.second, b.d1), one(i.second, b.d2);
  }

  Wrench6 times(const Twist& t) const {
    const Vec a = t.axis;
    const Vec turned{m[0] * a.x + m[3] * a.y + m[4] * a.z, m[3] * a.x + m[1] * a.y + m[5] * a.z,
                     m[4] * a.x + m[5] * a.y + m[2] * a.z};
    return {mass * t.shift + cross(a, first), cross(first, t.shift) + turned};
  }
};

// Where the chain is for its strains, and the twists of the strains.
struct Placed {
  std::vector<Mat> frames;          // of the nodes 0..elements
  std::vector<Vec> points;          // of the nodes
  std::vector<Body> middles, ends;  // of the elements
  std::vector<Twist> half, whole;   // elements x 6: of the middle, and of all beyond the element

  explicit Placed(int elements)
      : frames(elements + 1),
        points(elements + 1),
        middles(elements),
        ends(elements),
        half(kMaxStrains * elements),
        whole(kMaxStrains * elements) {}
};

// Half an element: its end, turn and the twists of the strains of the whole element, in the frame of its start.
struct HalfElement {
  Mat turn;
  Vec end;
  Twist by[kMaxStrains];
};

// T = 1 + b [w] + c [w]^2, whose columns are axes of turn by turn, and end = T (a, b, 1 + e) h / 2; the derivatives of
// b = (1 - cos t) / t^2 and c = (t - sin t) / t^3 by t^2 are those of their series. `count` strains get their twists.
inline HalfElement half_element(const double* strain, double length, int count) {
  const Vec w{-0.5 * strain[1], 0.5 * strain[0], 0.5 * strain[2]};
  const Vec reach = (0.5 * length) * Vec{strain[4], strain[5], 1.0 + strain[3]};
  const double q = dot(w, w);
  double b = 0.0, c = 0.0, db = 0.0, dc = 0.0;
  for (int n = 9; n >= 0; --n) {
    db = db * q + b, b = b * q + kVersine.term[n];
    dc = dc * q + c, c = c * q + kShift.term[n];
  }
  const Vec across = cross(w, reach), twice = cross(w, across);
  HalfElement out;
  out.end = reach + b * across + c * twice;
  const double a = 1.0 - q * c, d = 1.0 - b * q;
  out.turn = {{{d + b * w.x * w.x, b * w.x * w.y - a * w.z, b * w.x * w.z + a * w.y},
               {b * w.y * w.x + a * w.z, d + b * w.y * w.y, b * w.y * w.z - a * w.x},
               {b * w.z * w.x - a * w.y, b * w.z * w.y + a * w.x, d + b * w.z * w.z}}};
  const Vec turns[3] = {{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}};  // directions of w by u, v, t
  const Vec shifts[3] = {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}};  // of the end by e, a, b
  for (int k = 0; k < 3; ++k) {
    const Vec n = turns[k], wn = cross(w, n), nr = cross(n, reach);
    const Vec axis = 0.5 * (n + b * wn + c * cross(w, wn));
    const double along = 2.0 * dot(w, n);
    const Vec moved = (along * db) * across + b * nr + (along * dc) * twice + c * (cross(n, across) + cross(w, nr));
    out.by[k] = {axis, 0.5 * moved - cross(axis, out.end)};
  }
  for (int k = 3; k < count; ++k) {
    const Vec n = shifts[k - 3], wn = cross(w, n);
    out.by[k] = {{0, 0, 0}, (0.5 * length) * (n + b * wn + c * cross(w, wn))};
  }
  return out;
}

// Place all elements; `strain` has six numbers each, of which `count` may be other than 0 and get twists.
inline void place(const double* strain, const std::vector<double>& lengths, const std::vector<double>& rigid, int count,
                  Placed& p) {
  const int n = static_cast<int>(lengths.size());
  for (int e = 0; e < n; ++e) {
    const HalfElement h = half_element(strain + kMaxStrains * e, lengths[e], count);
    const Mat& R = p.frames[e];
    const Vec from = p.points[e], middle = from + R * h.end;
    const Mat at_middle = R * h.turn;
    for (int k = 0; k < count; ++k) {
      const Twist& t = h.by[k];
      const Vec axis = R * t.axis;
      p.half[kMaxStrains * e + k] = {axis, R * t.shift + cross(from, axis)};
      const Vec beyond = at_middle * t.axis;
      p.whole[kMaxStrains * e + k] = {axis + beyond,
                                      p.half[kMaxStrains * e + k].shift + at_middle * t.shift + cross(middle, beyond)};
    }
    p.middles[e] = {middle, column(at_middle, 0), column(at_middle, 1)};
    p.frames[e + 1] = at_middle * h.turn;
    p.points[e + 1] = middle + at_middle * h.end + rigid[e] * column(p.frames[e + 1], 2);
    p.ends[e] = {p.points[e + 1], column(p.frames[e + 1], 0), column(p.frames[e + 1], 1)};
  }
}

}  // namespace contid

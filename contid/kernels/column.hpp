// Three numbers and a spare one in a vector register: a point, a column of a matrix, or three rows of a system.
#pragma once

namespace contid {

// Every number goes the same way as by itself, so that the bits do not depend on the width of the registers.
typedef double Column __attribute__((vector_size(32)));

// Functions do not return columns: how a call hands them over depends on the registers of the build.

// (y, z, x) and (z, x, y) of a vector.
inline void rotate(const Column& a, Column& next, Column& after) {
  next = Column{a[1], a[2], a[0], 0.0};
  after = Column{a[2], a[0], a[1], 0.0};
}

// a x b
inline void cross(const Column& a, const Column& b, Column& to) {
  Column a1, a2, b1, b2;
  rotate(a, a1, a2);
  rotate(b, b1, b2);
  to = a1 * b2 - a2 * b1;
}

}  // namespace contid

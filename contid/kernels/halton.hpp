// Halton points, evenly spread in the unit cube: coordinate i of point k is radical_inverse(k, kPrimes[i]) (J. H.
// Halton, Numerische Mathematik 2, 1960). extras/clearance/contid_clearance/arm.py has the same in Python.
#pragma once

namespace contid {

constexpr int kPrimes[] = {
    2,  3,  5,  7,  11, 13, 17, 19, 23, 29, 31, 37,
    41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89};  // a base per coordinate, 3 for each of 8 sections

// Van der Corput's sequence in [0, 1): digits of the index mirrored at the point.
inline double radical_inverse(int index, int base) {
  double value = 0.0, scale = 1.0 / base;
  for (; index > 0; index /= base, scale /= base) value += (index % base) * scale;
  return value;
}

}  // namespace contid

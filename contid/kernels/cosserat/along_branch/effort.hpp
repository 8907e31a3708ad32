// How much a search along the branch may do, in the control loop and elsewhere.
#pragma once

#include "../discretisation.hpp"

namespace contid {

// Points next to a corner, and answers that are searched beside.
constexpr int kSets = 4, kDropped = 2;

// How much a search may do: work of short descents, points next to every corner, elements of a look at them, number and
// work of longer descents of the best, whether points around the best are tried, answers that are searched beside
// (`Beside`), work of the last descents; most elements with which it is made again where these lose an answer.
struct Effort {
  int work;
  int sets, look_elements;
  int longer, long_work;
  bool around;
  int beside, last_work;
  int again;
  int restarts;
};

constexpr Effort kTickEffort{450, 1, 2, 1, 60, false, 0, 140, 6, 20},
    kThoroughEffort{2600, kSets, 3, 12, 200, true, kDropped, 3000, kMaxElements, 100};

inline const Effort& effort_of(const Settings& settings) { return settings.thorough ? kThoroughEffort : kTickEffort; }

// What steps of descents cost, in those of two sections of three elements; and how many a cost allows.
constexpr int cost_of(int sections, int steps, int elements) { return (steps * elements * sections + 5) / 6; }
constexpr int steps_for(int sections, int cost, int elements) { return 6 * cost / (elements * sections); }

}  // namespace contid

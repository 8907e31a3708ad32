// Answers that stay when they are solved again from themselves.
//
// A first answer far from its seed may end where a search from itself would go on: beside a saddle of the distance to
// the centre, or where a descent along the branch took another way. It is solved again, each time from the answer
// before, until it moves by less than 1e-7 bar, four times at most. A thorough search goes on in the same way from a
// loaded answer out of reach, while that gets nearer to the target. Answers near their seed continue a motion, and
// every tick solves again anyway.
#pragma once

#include "search.hpp"

namespace contid {

constexpr int kMostSearches = 4;
constexpr double kSettledBar = 1e-7;

inline Found search_settled(const Rod& rod, const Task& task, Vec tip_force, const Limits& limits, const double* seed,
                            const Settings& settings) {
  const int n = rod.pressures();
  Found found = search(rod, task, tip_force, limits, seed, settings);
  const bool carries = loaded(rod, tip_force), redundant = task.independent() < n;
  // Where an answer is on the target or next to it the arm must get there from the seed; with the elements of the
  // answer: with fewer the same pressures hold another pose.
  const auto snap = [&](const Found& answer) {
    if (!carries || !at_target(answer.outcome)) return kNoSnap;
    return snap_from(rod, tip_force, limits, seed, answer.outcome, answer.elements);
  };
  for (int ask = 0; ask < kMostSearches; ++ask) {
    const bool met = found.outcome.met;
    if (!found.stable || most_change(n, found.outcome.pressures, seed) <= kTracking) break;
    if (met ? !redundant : !(carries && settings.thorough)) break;
    Found again = search(rod, task, tip_force, limits, found.outcome.pressures, settings);
    found.iterations += again.iterations;
    if (!again.stable || (met && !again.outcome.met)) break;
    if (met ? most_change(n, again.outcome.pressures, found.outcome.pressures) <= kSettledBar
            : !(again.outcome.residual < found.outcome.residual - settings.error))
      break;
    const double leaves = snap(again);
    if (leaves < kNoSnap && snap(found) == kNoSnap) {
      if (!met) found.snap = std::fmin(found.snap, leaves);
      break;
    }
    again.iterations = found.iterations;
    if (!again.outcome.met) again.snap = found.snap;
    found = again;
  }
  return found;
}

}  // namespace contid

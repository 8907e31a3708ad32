// Rows of a batch divided between threads, and the layout of their results: contid/kinematics/batch/rows.py.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <system_error>
#include <thread>
#include <vector>

namespace contid {

// Calls work(begin, end) for blocks that cover all rows; the calling thread takes part. A row must not depend on
// others.
template <class Work> void over_rows(std::size_t rows, int threads, const Work& work) {
  constexpr std::size_t kBlock = 64;  // rows of microseconds: the counter is touched seldom, the ends stay even
  std::atomic<std::size_t> next{0};
  const auto run = [&] {
    for (;;) {
      const std::size_t begin = next.fetch_add(kBlock, std::memory_order_relaxed);
      if (begin >= rows) return;
      work(begin, std::min(begin + kBlock, rows));
    }
  };
  const std::size_t blocks = (rows + kBlock - 1) / kBlock;
  std::vector<std::thread> others;
  try {
    for (std::size_t k = 1; k < std::min<std::size_t>(threads, blocks); ++k) others.emplace_back(run);
  } catch (const std::system_error&) {
    // No further thread to be had: those that run do the rows.
  }
  run();
  for (std::thread& other : others) other.join();
}

// Targets of a batch: rows of three numbers each; null where there are none.
struct TargetRows {
  const double *tip, *direction, *mid, *load;
  static const double* row(const double* vectors, std::size_t k) { return vectors ? vectors + 3 * k : nullptr; }
};

// A row of Solutions: values, residual, bits of the limits, iterations, converged.
constexpr std::size_t solution_bytes(int values) { return 8 * (values + 3); }

inline void write_solution(std::uint8_t* row, const double* values, int count, double residual, std::uint64_t limits,
                           std::int32_t iterations, bool converged) {
  std::memcpy(row, values, 8 * count);
  row += 8 * count;
  std::memcpy(row, &residual, 8);
  std::memcpy(row + 8, &limits, 8);
  std::memcpy(row + 16, &iterations, 4);
  row[20] = converged;
}

// A row of Poses: tip, rotation, direction, mid-point, stable.
constexpr std::size_t kPoseBytes = 152;

inline void write_pose(std::uint8_t* row, const double* tip, const double* rotation, const double* direction,
                       const double* mid, bool stable) {
  std::memcpy(row, tip, 24);
  std::memcpy(row + 24, rotation, 72);
  std::memcpy(row + 96, direction, 24);
  std::memcpy(row + 120, mid, 24);
  row[144] = stable;
}

}  // namespace contid

// Whether the encoder moves with the drive: the drive is compared with the counts that it must cause.
#ifndef CONTID_ENCODER_WATCH_H
#define CONTID_ENCODER_WATCH_H

#include "config.h"
#include "protocol.h"

namespace contid {

// The slowest shaft within rating stands below `need` of duty and has the inertia of four times the file's time
// constant. The drive above `need` is summed once (its momentum) and twice (its way, which the count owes); each
// advance of the count along the drive starts both anew. A count that has not advanced when that shaft would have is
// the fault.
class EncoderWatch {
 public:
  void configure(const MotorConfig& config);
  // Expects nothing before the next tick; a shaft at rest is driven against its load only.
  void rest(int32_t position);
  // Starts anew; `need` is the duty below which a shaft may stand from now on.
  void start(int32_t position, int32_t need);
  // One tick under `duty`; `moved` are the counts of the last eight ticks, `excused` when standing is no fault.
  void tick(int32_t position, int32_t moved, int32_t duty, bool excused);

  // The count did not advance although the drive was enough for it.
  bool failed() const { return owed_ > limit_; }
  // The count runs against the drive.
  bool backward() const { return backward_; }
  // The count goes to and fro: one track shows edges, the other none.
  bool one_track() const { return edges_ >= ONE_TRACK; }
  // The count advanced since the drive turned.
  bool advanced() const { return advanced_; }
  // Ticks since the count advanced.
  int32_t idle() const { return idle_; }

 private:
  // What the shaft does in one tick; the first that holds.
  enum class Shaft : uint8_t {
    TURNED,     // the drive has another sign than before
    ADVANCED,   // the count is ADVANCE further along the drive than the mark
    RUNS_OUT,   // still runs against the drive, no faster than when the drive turned
    OWES,       // the drive is more than it needs, and nothing excuses it; or its count runs backward
    EXCUSED,    // it may stand
    GIVES_WAY,  // a load turns it against a drive that is less than it needs
    MAY_STAND   // the drive is less than it needs
  };
  // The drive and the shaft in one tick; counts are positive along the drive.
  struct Seen {
    int32_t side, drive;  // sign and magnitude of the duty
    int32_t ahead;        // counts since the mark
    int32_t speed;        // counts in eight ticks
    bool behind;          // the count has run backward since the mark
    bool excused;
  };
  Shaft judge(const Seen& seen) const;

  void mark(int32_t position);
  void turn(int32_t position, int32_t speed);
  void learn_need(int32_t speed, int32_t drive);

  static const int32_t ONE_TRACK = 3;  // edges without an advance

  int32_t inertia_, kv_, limit_, play_;  // of the configuration
  int32_t base_, need_;                  // least and present duty that may be needed to move
  int32_t side_, mark_, last_;           // direction of the drive, furthest count along it, newest count
  int32_t idle_, edges_;                 // ticks and edges since the mark
  bool backward_;                        // the count runs against the drive now
  bool advanced_;                        // since the drive turned
  int32_t momentum_, owed_;              // duty ticks, below 0 against the drive; duty ticks squared
  int32_t against_;                      // counts in eight ticks against the drive, when it turned
};

}  // namespace contid

#endif

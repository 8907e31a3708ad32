// Parameters and motion of the simulated plant.
#include "plant.h"

namespace contid {

namespace {
const int SUBSTEPS = 4;
}

bool Plant::set(int channel, const std::string& name, double value) {
  MotorPlant& m = motor[channel];
  RegulatorPlant& r = regulator[channel];
  TendonPlant& t = tendon[channel];
  struct {
    const char* name;
    double* value;
  } const numbers[] = {
      {"no_load", &m.no_load},
      {"tau", &m.tau},
      {"friction", &m.friction},
      {"low", &m.low},
      {"high", &m.high},
      {"stall_ma", &m.stall_ma},
      {"shaft", &m.shaft},
      {"full_scale_ma", &m.full_scale_ma},
      {"full_pa", &r.full_pa},
      {"lag", &r.tau},
      {"supply", &r.supply_pa},
      {"opens", &r.opens_s},
      {"shuts", &r.shuts_s},
      {"swelling", &r.swelling},
      {"flow", &r.flow},
      {"raw_low", &r.raw_low},
      {"low_pa", &r.low_pa},
      {"raw_high", &r.raw_high},
      {"high_pa", &r.high_pa},
      {"pressure", &r.pressure},
      {"missed", &m.missed},
      {"encoder_share", &m.encoder_share},
      {"tendon", &t.mn_per_count},
      {"tendon_slack_at", &t.slack_at},
      {"tendon_pull", &t.pull},
      {"cell_zero", &t.zero},
      {"cell_steps", &t.steps_per_mn},
      {"cell_period", &t.period_ms},
      {"cell_noise", &t.noise},
  };
  if ((name == "motor_of" || name == "encoder_of") && value >= 0.0 && value < CHANNELS) {
    (name == "motor_of" ? motor_of : encoder_of)[channel] = static_cast<int>(value);
    return true;
  }
  if (name == "cell_of" && value >= 0.0 && value < CHANNELS) {
    cell_of[channel] = static_cast<int>(value);
    return true;
  }
  if (name == "encoder_jump") {
    m.encoder += value;
    return true;
  }
  for (const auto& number : numbers) {
    if (name == number.name) {
      *number.value = value;
      return true;
    }
  }
  struct {
    const char* name;
    bool* value;
  } const switches[] = {
      {"stall", &m.stalled},
      {"bridge", &m.bridge},
      {"encoder_stuck", &m.stuck},
      {"encoder_reversed", &m.reversed},
      {"wired_coast", &m.wired_coast},
      {"motor_wired", &m.motor_wired},
      {"encoder_wired", &m.encoder_wired},
      {"leak", &r.leaking},
      {"wire", &r.wire_broken},
      {"read_back_frozen", &r.frozen},
      {"encoder_track_a", &m.open_a},
      {"encoder_track_b", &m.open_b},
      {"valve_stuck", &r.stuck},
      {"outlet_open", &r.outlet_open},
      {"tendon_cut", &t.cut},
      {"cell_open", &t.open},
      {"cell_saturated", &t.saturated},
      {"cell_frozen", &t.frozen},
  };
  for (const auto& one : switches) {
    if (name == one.name) {
      *one.value = value != 0.0;
      return true;
    }
  }
  return false;
}

void Plant::step(const Outputs& out, bool motors) {
  if (off) return;
  for (int i = 0; i < CHANNELS; ++i) {
    for (int s = 0; s < SUBSTEPS; ++s) {
      const double dt = 1.0 / TICK_HZ / SUBSTEPS;
      if (motors) {
        motor[i].step(out.channel[motor_of[i]], dt);
      } else {
        regulator[i].step(out.channel[i], dt);
      }
    }
  }
  for (TendonPlant& each : tendon) ++each.age_ms;
  read(motors);
  if (motors) read_cells();
}

// The converters finish in their period; the analogue inputs are read in every tick.
void Plant::read_cells() {
  inputs.cell_fresh = 0;
  for (int i = 0; i < CHANNELS; ++i) {
    TendonPlant& t = tendon[cell_of[i]];
    if (t.mn_per_count == 0.0) continue;
    const double shaft = motor[cell_of[i]].shaft;
    inputs.cell_analog[i] = t.reading(shaft, 0.0, adc_steps);
    if (tendon[i].age_ms < t.period_ms) continue;
    tendon[i].age_ms = 0;
    inputs.cell_steps[i] = t.reading(shaft, -8388608.0, 8388607.0);
    inputs.cell_fresh = static_cast<uint8_t>(inputs.cell_fresh | (1u << i));
  }
}

void Plant::read(bool motors) {
  if (off) return;
  inputs.bridge_faults = 0;
  inputs.supply_low = supply_low;
  for (int i = 0; i < CHANNELS; ++i) {
    if (motor[i].bridge) inputs.bridge_faults = static_cast<uint8_t>(inputs.bridge_faults | (1u << i));
    const MotorPlant& read = motor[encoder_of[i]];
    inputs.count[i] = read.count();
    inputs.missed[i] = static_cast<uint32_t>(read.missed);
    inputs.edges_a[i] = read.edges_a;
    inputs.edges_b[i] = read.edges_b;
    inputs.analog[i] = motors ? motor[i].analog(adc_steps) : regulator[i].analog(adc_steps);
  }
}

}  // namespace contid

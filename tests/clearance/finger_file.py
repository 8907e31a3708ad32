"""A robot file of one finger with an obstacle."""

FINGER = """
contid: 1
name: post
rate_hz: 100
buses: {b: {driver: sim}}
robots:
  f:
    model: rack_finger
    geometry: {rack_spacing_mm: 13, tip_length_mm: 22, link: {length_mm: 6, width_mm: 13, gap_mm: 5}}
    limits: {length_mm: [0, 100]}
    rates: {velocity_mm_s: 60, acceleration_mm_s2: 1000, jerk_mm_s3: 20000}
    rest_mm: [60, 60]
    axes:
      left: {bus: b, device: servo, mm_per_rev: 37.7}
      right: {bus: b, device: servo, mm_per_rev: 37.7}
clearance:
  margin_mm: 1
  bodies: {f: {radius_mm: 7}}
  obstacles:
    OBSTACLE
"""
#: Between the two sides of the finger: bending from one to the other sweeps over it.
POST = "post: {capsule: {start_mm: [0, 100, -50], end_mm: [0, 100, 50], radius_mm: 5}}"
WALL = "wall: {plane: {point_mm: [40, 0, 0], normal: [-1, 0, 0]}}"

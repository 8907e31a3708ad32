"""A camera as a tracker of tips: calibration, tags, poses that are worth sending."""

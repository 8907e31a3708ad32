"""The parts of the fit of a `contid_identify.tip_motion.TipMotion`."""

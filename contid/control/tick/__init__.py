"""One tick of one robot: pure functions of configuration, state, time, samples and target."""

"""Public classes of ``contid`` beside those of the core: simulated runs and elastic rods for scripts."""

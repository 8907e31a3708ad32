"""The public library: robots, recordings and simulated runs for scripts and notebooks; stable from 0.1.0."""

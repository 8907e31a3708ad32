"""The way of the commands to the answer of a model: chords of the tip, joints in step, redundant axes."""

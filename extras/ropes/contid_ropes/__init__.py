"""Closed chains of two arms and a rope, and Pythagorean-hodograph curves as shapes of bodies."""

"""Commands that move robots by hand: teaching, playing what was taught, jogging."""

"""`contid home`: the zero of axes, searched, by hand or by their parked pose."""

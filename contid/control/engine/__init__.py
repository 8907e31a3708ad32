"""One cycle of all robots: targets, ticks, bus exchange, records."""

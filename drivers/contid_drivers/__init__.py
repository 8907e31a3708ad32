"""Drivers: each folder speaks to one kind of hardware, or stands in for it."""

"""Contacts of a tip or of an axis, found in the ticks of a robot, and the reactions to them."""

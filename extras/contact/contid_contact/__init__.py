"""Contacts found in the currents of servos, the reactions to them, and tips that close until a force."""

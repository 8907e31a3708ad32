"""Tendon robots: sections of constant curvature, bent by tendons that end at the discs of the sections."""

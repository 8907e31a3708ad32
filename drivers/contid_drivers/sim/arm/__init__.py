"""The body of a simulated pneumatic arm: where its tip is, and what a tracker measures of it."""

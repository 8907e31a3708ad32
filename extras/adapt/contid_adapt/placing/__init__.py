"""Where a table lies in the world of a robot, and the trajectory that is written."""

"""Constant-curvature sections: kinematics and bounded inverse kinematics."""

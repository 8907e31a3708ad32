"""What was proven about the axes of a robot file."""

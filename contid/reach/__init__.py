"""Where the robots of a file can go."""

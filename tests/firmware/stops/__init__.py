"""What a stop takes away."""

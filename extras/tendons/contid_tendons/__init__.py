"""Tendon robots under loads, and with drives that pull several tendons."""

"""A board at rest for weeks."""

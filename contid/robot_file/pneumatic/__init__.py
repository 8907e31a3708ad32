"""Parts of the description of a pneumatic arm."""

"""Arms of pneumatic sections in motion: each section an arc that its chambers bend and lengthen."""

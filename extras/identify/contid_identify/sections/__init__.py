"""Arms of sections in motion: bends that stiffen one another, and their fit to tips."""

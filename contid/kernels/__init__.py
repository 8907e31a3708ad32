"""Compiled hot paths behind the models; each has a NumPy twin that specifies it."""

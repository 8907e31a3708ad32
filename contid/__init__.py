"""contid: a daemon that makes continuum robots move."""

__version__ = "0.1.0"

"""Recordings that are no sessions of contid: tables of other programs."""

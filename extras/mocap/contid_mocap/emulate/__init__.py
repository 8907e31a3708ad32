"""Emulated servers of motion-capture rooms, each in a process of its own: ``contid track emulate``.

Encoders share nothing with the decoders; they only know the layouts.
"""

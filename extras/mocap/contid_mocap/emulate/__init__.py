"""Emulated servers of motion-capture rooms, each in a process of its own: ``python -m contid_mocap.emulate``.

Encoders share nothing with the decoders; they only know the layouts.
"""

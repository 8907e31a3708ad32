"""NatNet 3.0 to 4.1, the protocol of OptiTrack's Motive.

Facts: the NatNet SDK (`NatNetTypes.h`, `PacketClient.cpp`), and packets of Motive 2.1 recorded in
mje-nz/python_natnet.
"""

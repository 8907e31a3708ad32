"""The UDP object stream of Vicon Tracker.

Facts: the packet structure of the Vicon Tracker User Guide, as the public receivers
TheWorkshopByGM/Vicon_UDP_Stream and BoBRobotics::Vicon::UDPClient read it.
"""
